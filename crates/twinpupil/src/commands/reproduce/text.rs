//! The comparison for the terminal.

use crate::experiments::{Comparison, published};
use crate::text_table;

/// Width of the text, columns.
const WIDTH: usize = 110;

/// The table, then the explanations that it refers to by number, then the choices.
pub(super) fn table(comparison: &Comparison, choices: &[String]) -> String {
    let [published, thin_paper, fresnel_paper, fresnel_model] = Comparison::headings();
    let headings = [published, thin_paper, fresnel_paper, fresnel_model];
    let line = |k: usize| headings.map(|heading| heading[k].to_owned());
    let mut rows = vec![row("", line(1), "why")];
    for section in &comparison.sections {
        rows.push(row("", Default::default(), ""));
        rows.push(row(section.title, Default::default(), ""));
        for quantity in &section.rows {
            let name = format!("  {}", quantity.quantity);
            rows.push(row(&name, quantity.cells(), &quantity.explanation.number().to_string()));
        }
    }
    let [a, b, c, d] = line(0);
    let mut text = text_table::render(["", &a, &b, &c, &d, ""], &rows);

    text += "\nWhy the columns differ\n";
    for note in &comparison.notes {
        text += &item(&format!("{}. ", note.explanation.number()), &note.text);
    }
    text += "\nStated choices, where the paper's text leaves them open\n";
    choices.iter().for_each(|choice| text += &item("–  ", choice));
    text + &format!("\n[Ohno2018]: {}\n", published::CITATION)
}

fn row(name: &str, cells: [String; 4], why: &str) -> [String; 6] {
    let [a, b, c, d] = cells;
    [name.to_owned(), a, b, c, d, why.to_owned()]
}

/// A paragraph behind a mark, broken at spaces.
fn item(mark: &str, text: &str) -> String {
    let indent = " ".repeat(mark.chars().count());
    let mut lines = vec![String::new()];
    for word in text.split_whitespace() {
        let last = lines.last_mut().expect("there is always a line");
        if !last.is_empty() && indent.len() + last.chars().count() + 1 + word.chars().count() > WIDTH {
            lines.push(word.to_owned());
        } else {
            let space = if last.is_empty() { "" } else { " " };
            *last += &format!("{space}{word}");
        }
    }
    let begin = |k: usize| if k == 0 { mark } else { indent.as_str() };
    lines.iter().enumerate().map(|(k, line)| format!("{}{line}\n", begin(k))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_items_are_broken_and_hang() {
        let text = item("1. ", &"word ".repeat(40));
        assert!(text.lines().all(|line| line.chars().count() <= WIDTH));
        let mut lines = text.lines();
        assert!(lines.next().unwrap().starts_with("1. word") && lines.next().unwrap().starts_with("   word"));
    }
}
