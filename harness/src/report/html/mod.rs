//! One HTML file with everything in it: no network, no scripts or pictures from elsewhere, light and dark, readable on a
//! phone. Drawn from a result file alone.

mod escape;
mod figures;
mod sections;
mod table;

use super::view::View;
use crate::record::result::{Cell, ResultFile};
use escape::{escape, json_in_script};
use std::fmt::Write;

pub use figures::{display_rates, panel};

const STYLE: &str = include_str!("page.css");
const SCRIPT: &str = include_str!("page.js");

/// A page about `results`, each with the name of its file. Results of different files never share a rank or a picture.
pub fn page(results: &[(String, ResultFile)]) -> String {
    let title = match results {
        [(name, _)] => format!("lapbench: {name}"),
        several => format!("lapbench: {} results", several.len()),
    };
    let mut body = String::new();
    for (index, (name, result)) in results.iter().enumerate() {
        let _ = write!(body, "<article id=\"r{index}\">{}</article>", article(name, result, index));
    }
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; style-src 'unsafe-inline'; \
         script-src 'unsafe-inline'; img-src data:\">\n\
         <link rel=\"icon\" href=\"data:,\">\n\
         <title>{}</title>\n<style>\n{STYLE}\n{}</style>\n</head>\n<body>\n<header><h1>{}</h1></header>\n<main>\n{body}\n</main>\n\
         <script>\n{SCRIPT}\n</script>\n</body>\n</html>\n",
        escape(&title),
        figures::colours(),
        escape(&title),
    )
}

fn article(name: &str, result: &ResultFile, index: usize) -> String {
    let view = View::new(result);
    let mut page = String::new();
    page += &sections::verdict(name, &view);
    page += &sections::ranks(&view);
    page += &sections::validation(&view);
    page += &figures::phases(&view);
    page += &figures::accuracy(&view);
    page += &figures::cost(&view);
    page += &figures::scaling(&view);
    page += &figures::columns(&view);
    page += &figures::memory(&view);
    page += &figures::bandwidth(&view);
    page += &figures::latency(&view);
    page += &table::all_cells(&view);
    page += &sections::environment(result);
    page += &sections::reproduce(result);
    page + &embedded(result, index)
}

/// The result itself, without samples: enough to draw all but the latencies again.
fn embedded(result: &ResultFile, index: usize) -> String {
    let cells = result.cells.iter().map(|cell| Cell { samples_ns: Vec::new(), ..cell.clone() }).collect();
    let lean = ResultFile { cells, ..result.clone() };
    let json = json_in_script(&crate::record::file::text(&lean));
    format!("<script type=\"application/json\" id=\"data{index}\">{json}</script>\n")
}

/// A section with a heading and a line on how to read it.
fn section(title: &str, lead: &str, content: &str) -> String {
    if content.is_empty() {
        return String::new();
    }
    format!("<section><h2>{title}</h2><p class=\"lead\">{lead}</p>{content}</section>\n")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::names::Status;
    use crate::record::result::Mesh;

    #[test]
    fn names_are_escaped_everywhere_and_nothing_is_loaded() {
        let evil = "<img src=x onerror=alert(1)>\"'&</script><script>alert(2)</script>";
        let cell = |status, ns: u64| Cell {
            mesh: Mesh { name: evil.into(), triangles: Some(ns as usize), ..Mesh::default() },
            workload: evil.into(),
            backend: format!("{evil}{ns}"),
            reason: Some(evil.into()),
            device: Some(evil.into()),
            status,
            precision: Some(crate::record::names::Precision::F64),
            solve_ns: crate::record::result::Summary::of(&[ns; 8]),
            samples_ns: vec![ns; 8],
            details: [(evil.to_owned(), evil.to_owned())].into(),
            ..Cell::default()
        };
        let result = ResultFile {
            schema_version: "1.1".into(),
            command: evil.into(),
            quotable: false,
            environment: Default::default(),
            cells: vec![cell(Status::Ok, 1_000), cell(Status::Ok, 2_000), cell(Status::Invalid, 3)],
        };
        let page = page(&[(evil.into(), result)]);
        assert!(!page.contains("<img") && !page.contains("alert(2)</script><"), "markup came through");
        assert_eq!(page.matches("<script").count(), page.matches("</script>").count());
        assert_eq!(page.matches("<script").count(), 2); // the data, the page's own
        for address in ["http:", "https:", "//cdn", "url("] {
            let outside: Vec<_> = page.match_indices(address).map(|(at, _)| &page[at..at + 30]).collect();
            assert!(outside.iter().all(|a| a.starts_with("http://www.w3.org/2000/svg")), "{outside:?}");
        }
    }

    #[test]
    fn an_empty_result_is_a_page_too() {
        let result = ResultFile {
            schema_version: "1.1".into(),
            command: "lapbench run".into(),
            quotable: true,
            environment: Default::default(),
            cells: Vec::new(),
        };
        assert!(page(&[("a.json".into(), result)]).contains("0 of 0"));
    }
}
