//! Rows of text, and the forms in which they are printed.

use crate::cmd::output::Format;
use comfy_table::{LineStyle, TableStyle};

/// Rows of text with a header, printed in any [`Format`] but JSON.
#[derive(Clone, Debug, Default)]
pub struct Rows {
    /// Column titles.
    pub header: Vec<String>,
    /// One vector per row, as long as the header.
    pub rows: Vec<Vec<String>>,
}

impl Rows {
    /// No rows yet.
    pub fn new<const N: usize>(header: [&str; N]) -> Self {
        Self { header: header.map(str::to_owned).to_vec(), rows: Vec::new() }
    }

    /// Adds a row as long as the header.
    ///
    /// # Panics
    /// If it is not.
    pub fn push<const N: usize>(&mut self, row: [&str; N]) {
        assert_eq!(N, self.header.len(), "row: one cell per column");
        self.rows.push(row.map(str::to_owned).to_vec());
    }

    /// The rows as a table, CSV or Markdown; JSON is the caller's business and treated as `Human` here.
    pub fn render(&self, format: Format) -> String {
        match format {
            Format::Csv => {
                self.lines(|cells| cells.iter().map(|c| quote_csv(c)).collect::<Vec<_>>().join(","))
            }
            Format::Markdown => self.markdown(),
            Format::Human | Format::Json => self.table(),
        }
    }

    fn lines(&self, line: impl Fn(&[String]) -> String) -> String {
        std::iter::once(&self.header).chain(&self.rows).map(|cells| line(cells) + "\n").collect()
    }

    fn markdown(&self) -> String {
        let escape = |cells: &[String]| {
            cells.iter().map(|c| c.replace('|', "\\|").replace('\n', " ")).collect::<Vec<_>>().join(" | ")
        };
        let mut text = format!("| {} |\n|{}\n", escape(&self.header), "---|".repeat(self.header.len()));
        for row in &self.rows {
            text += &format!("| {} |\n", escape(row));
        }
        text
    }

    /// Columns of numbers to the right, text to the left, a line below the header, nothing else.
    fn table(&self) -> String {
        let mut table = comfy_table::Table::new();
        table.load_style(STYLE).set_content_arrangement(comfy_table::ContentArrangement::Dynamic);
        table.set_header(&self.header).add_rows(&self.rows);
        for (i, column) in table.column_iter_mut().enumerate() {
            column.set_padding((0, 1));
            let numbers = |row: &Vec<String>| row[i].is_empty() || row[i].parse::<f64>().is_ok();
            if self.rows.iter().all(numbers) {
                column.set_cell_alignment(comfy_table::CellAlignment::Right);
            }
        }
        table.trim_fmt()
    }
}

const STYLE: TableStyle = TableStyle::new().header_separator(LineStyle::none().fill('-').junction('-'));

/// RFC 4180: fields with commas, quotes or line breaks are quoted, quotes doubled.
fn quote_csv(field: &str) -> String {
    if field.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", field.replace('"', "\"\""))
    } else {
        field.to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hostile_names_do_not_break_the_forms() {
        let mut rows = Rows::new(["a", "b"]);
        rows.push(["x,\"y", "p|q"]);
        assert_eq!(rows.render(Format::Csv), "a,b\n\"x,\"\"y\",p|q\n");
        assert_eq!(rows.render(Format::Markdown), "| a | b |\n|---|---|\n| x,\"y | p\\|q |\n");
    }
}
