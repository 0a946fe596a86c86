//! One self-contained HTML page: text, tables and figures, light or dark as the reader prefers, nothing loaded from
//! elsewhere.

/// A page in the making. Every text is escaped; only figures are markup.
#[derive(Debug, Clone, PartialEq)]
pub struct Report {
    title: String,
    body: String,
}

/// A column of a table.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Column {
    heading: String,
    is_number: bool,
}

impl Column {
    /// Words, aligned left.
    pub fn text(heading: &str) -> Self {
        Self { heading: heading.to_owned(), is_number: false }
    }

    /// Numbers, aligned right.
    pub fn number(heading: &str) -> Self {
        Self { heading: heading.to_owned(), is_number: true }
    }

    fn cell(&self, tag: &str, text: &str) -> String {
        let class = if self.is_number { " class=\"number\"" } else { "" };
        format!("<{tag}{class}>{}</{tag}>", escaped(text))
    }
}

/// A drawing or a picture with what it shows.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Figure {
    /// An `<svg>` or `<img>` element.
    pub markup: String,
    /// One or two sentences.
    pub caption: String,
}

impl Figure {
    /// A figure from an `<svg>` or `<img>` element and its caption.
    pub fn new(markup: String, caption: impl Into<String>) -> Self {
        Self { markup, caption: caption.into() }
    }
}

/// A number in large print.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Headline {
    /// The number with its unit.
    pub number: String,
    /// What it is.
    pub label: String,
}

impl Headline {
    /// A number and what it is.
    pub fn new(number: impl Into<String>, label: impl Into<String>) -> Self {
        Self { number: number.into(), label: label.into() }
    }
}

impl Report {
    /// A page under a title.
    pub fn new(title: &str) -> Self {
        Self { title: title.to_owned(), body: format!("<h1>{}</h1>\n", escaped(title)) }
    }

    /// Adds the paragraph that says what the page is about.
    pub fn lead(&mut self, text: &str) {
        self.body += &format!("<p class=\"lead\">{}</p>\n", escaped(text));
    }

    /// Adds a heading.
    pub fn heading(&mut self, text: &str) {
        self.body += &format!("<h2>{}</h2>\n", escaped(text));
    }

    /// Adds a heading within a section.
    pub fn subheading(&mut self, text: &str) {
        self.body += &format!("<h3>{}</h3>\n", escaped(text));
    }

    /// Adds numbers in large print, side by side.
    pub fn headlines(&mut self, headlines: &[Headline]) {
        self.body += "<dl class=\"headlines\">\n";
        for Headline { number, label } in headlines {
            self.body += &format!("<div><dd>{}</dd><dt>{}</dt></div>\n", escaped(number), escaped(label));
        }
        self.body += "</dl>\n";
    }

    /// Adds a list with bullets.
    pub fn list(&mut self, items: &[String]) {
        self.items("ul", items);
    }

    /// Adds a list numbered from 1.
    pub fn numbered(&mut self, items: &[String]) {
        self.items("ol", items);
    }

    fn items(&mut self, tag: &str, items: &[String]) {
        let lines: String = items.iter().map(|item| format!("<li>{}</li>\n", escaped(item))).collect();
        self.body += &format!("<{tag}>\n{lines}</{tag}>\n");
    }

    /// Adds a paragraph.
    pub fn paragraph(&mut self, text: &str) {
        self.body += &format!("<p>{}</p>\n", escaped(text));
    }

    /// Adds a table of as many cells a row as there are columns.
    pub fn table<const N: usize>(&mut self, columns: &[Column; N], rows: &[[String; N]]) {
        let line = |tag: &str, cells: [&str; N]| {
            let cells: String = columns.iter().zip(cells).map(|(column, cell)| column.cell(tag, cell)).collect();
            format!("<tr>{cells}</tr>\n")
        };
        let head = line("th", std::array::from_fn(|i| columns[i].heading.as_str()));
        let body: String = rows.iter().map(|row| line("td", std::array::from_fn(|i| row[i].as_str()))).collect();
        self.body +=
            &format!("<div class=\"scroll\"><table>\n<thead>{head}</thead>\n<tbody>{body}</tbody>\n</table></div>\n");
    }

    /// Adds figures, side by side where the page is wide enough.
    pub fn figures(&mut self, figures: &[Figure]) {
        self.body += "<div class=\"figures\">\n";
        for figure in figures {
            let (markup, caption) = (&figure.markup, escaped(&figure.caption));
            self.body += &format!("<figure>{markup}<figcaption>{caption}</figcaption></figure>\n");
        }
        self.body += "</div>\n";
    }

    /// The page.
    pub fn into_html(self) -> String {
        let (title, style, body) = (escaped(&self.title), include_str!("report.css"), self.body);
        let version = env!("CARGO_PKG_VERSION");
        format!(
            "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<title>{title}</title>\n\
             <style>\n{style}</style>\n</head>\n<body>\n{body}<footer>Written by twinpupil {version}.</footer>\n\
             </body>\n</html>\n"
        )
    }
}

/// `text` so that HTML and SVG show it as it is.
pub fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_escaped_and_nothing_is_loaded() {
        let mut report = Report::new("R² < 1 & more");
        report.lead("\"lead\"");
        report.headlines(&[Headline::new("< 1 mm", "a & b")]);
        report.numbered(&["<b>".to_owned()]);
        report.table(&[Column::text("what"), Column::number("mm")], &[["<a>".to_owned(), "1.5".to_owned()]]);
        report.figures(&[Figure::new("<svg></svg>".to_owned(), "a & b")]);
        let html = report.into_html();
        assert!(html.contains("<title>R² &lt; 1 &amp; more</title>"));
        assert!(html.contains("<td>&lt;a&gt;</td><td class=\"number\">1.5</td>"));
        assert!(html.contains("<figure><svg></svg><figcaption>a &amp; b</figcaption></figure>"));
        assert!(html.contains("<dd>&lt; 1 mm</dd>") && html.contains("<li>&lt;b&gt;</li>"));
        assert!(!html.contains("http"), "{html}");
    }
}
