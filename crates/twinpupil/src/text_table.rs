//! Tables for the terminal.

/// Columns under a header, the first aligned left, all others right, two spaces between them.
pub fn render<const N: usize>(header: [&str; N], rows: &[[String; N]]) -> String {
    let width = |column: usize| {
        let cells = rows.iter().map(|row| row[column].chars().count());
        cells.chain([header[column].chars().count()]).max().unwrap_or(0)
    };
    let widths: [usize; N] = std::array::from_fn(width);
    let header = header.map(str::to_owned);
    std::iter::once(&header).chain(rows).map(|row| line(row, &widths)).collect()
}

fn line<const N: usize>(cells: &[String; N], widths: &[usize; N]) -> String {
    let aligned = cells.iter().zip(widths).enumerate().map(|(column, (cell, &width))| match column {
        0 => format!("{cell:<width$}"),
        _ => format!("{cell:>width$}"),
    });
    let joined = aligned.collect::<Vec<_>>().join("  ");
    format!("{}\n", joined.trim_end())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_stand_under_each_other() {
        let rows = [["a".to_owned(), "1.5".to_owned()], ["Γ".to_owned(), "10.5".to_owned()]];
        assert_eq!(render(["", "z, mm"], &rows), "   z, mm\na    1.5\nΓ   10.5\n");
    }
}
