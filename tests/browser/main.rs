//! The HTML report in a real browser: opens without errors or requests, sorts and filters, fits a phone, has a dark mode.

mod driver;

use driver::Browser;
use serde_json::json;
use std::path::{Path, PathBuf};
use std::process::Command;
use tests::needs::{self, Need};

/// A report of a short run with good, slow and wrong backends on two meshes and two workloads.
fn report(folder: &Path) -> PathBuf {
    let (result, page) = (folder.join("r.json"), folder.join("r.html"));
    let lapbench = |arguments: &str, files: &[&Path]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_lapbench-faulty"));
        let output =
            command.args(arguments.split_whitespace()).args(files).output().expect("the program starts");
        assert!(output.status.code().is_some_and(|code| code == 0 || code == 4), "{output:?}");
    };
    let run = "run --quick --mesh sphere:2,sphere:3 --workload harmonic,transfer --threads 1 --cell-time 0.2 \
               --backend dense,faer-llt,cg-jacobi,slow,wrong,absent --out";
    lapbench(run, &[&result]);
    lapbench("report --format html --out", &[&page, &result]);
    page
}

/// The texts of a column of the rows that are shown.
fn column(browser: &Browser, title: &str) -> Vec<String> {
    let script = format!(
        "const at = [...document.querySelectorAll('.sortable th')].findIndex((th) => th.textContent === {});
         const rows = [...document.querySelectorAll('.sortable tbody tr')].filter((row) => !row.hidden);
         return rows.map((row) => row.cells[at].dataset.key ?? row.cells[at].textContent);",
        json!(title)
    );
    let texts = browser.run(&script);
    texts.as_array().expect("rows").iter().map(|text| text.as_str().expect("text").to_owned()).collect()
}

fn sort_by(browser: &Browser, title: &str) {
    let script = format!(
        "[...document.querySelectorAll('.sortable th')].find((th) => th.textContent === {}).id = 'title-to-click';",
        json!(title)
    );
    browser.run(&script);
    browser.click("#title-to-click button");
    browser.run("document.getElementById('title-to-click').removeAttribute('id');");
}

fn numbers(texts: &[String]) -> Vec<f64> {
    texts.iter().filter_map(|text| text.parse().ok()).collect()
}

#[test]
fn the_report_works_in_a_browser() {
    let browser = match Browser::start() {
        Ok(browser) => browser,
        Err(reason) => return needs::skip(Need::Browser, &reason),
    };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let page = report(folder.path());
    browser.emulate(1280, 1000, false);
    browser.open(&page);

    sorts(&browser);
    filters(&browser);
    fits_and_darkens(&browser);

    let requests = browser.requests();
    let own =
        |address: &String| address.starts_with("data:") || *address == format!("file://{}", page.display());
    assert!(!requests.is_empty() && requests.iter().all(own), "{requests:?}");
    let console = browser.console();
    assert!(console.is_empty(), "{console:?}");

    // The watch itself works: an error and a request are seen.
    browser.run("console.error('seen'); new Image().src = 'file:///nowhere.png'; return 0;");
    assert!(browser.console().iter().any(|line| line.contains("seen")));
    assert!(browser.requests().iter().any(|address| address.ends_with("nowhere.png")));
}

fn sorts(browser: &Browser) {
    let before = column(browser, "median ms");
    assert_eq!(before.len(), 24);
    sort_by(browser, "median ms");
    let up = column(browser, "median ms");
    assert!(numbers(&up).is_sorted() && numbers(&up).len() > 8, "{up:?}");
    assert!(up[numbers(&up).len()..].iter().all(String::is_empty), "unknown ones come last: {up:?}");
    sort_by(browser, "median ms");
    let down = column(browser, "median ms");
    assert!(numbers(&down).iter().rev().is_sorted(), "{down:?}");
    assert!(down[down.len() - 1].is_empty());
    sort_by(browser, "solver");
    assert!(column(browser, "solver").is_sorted());
}

fn filters(browser: &Browser) {
    browser.type_into("input[type=search]", "transfer FAER");
    assert_eq!(column(browser, "solver"), ["faer-llt", "faer-llt"]);
    assert_eq!(column(browser, "workload"), ["transfer", "transfer"]);
    browser.run("const i = document.querySelector('input[type=search]'); i.value = ''; i.dispatchEvent(new Event('input'));");
    assert_eq!(column(browser, "solver").len(), 24);
    browser.click(".only-ok");
    let statuses = column(browser, "status");
    assert!(!statuses.is_empty() && statuses.iter().all(|s| s.starts_with("ok")), "{statuses:?}");
    assert!(!column(browser, "solver").contains(&"wrong".to_owned()));
    browser.click(".only-ok");
}

/// Pictures for people to look at stay in the build folder.
fn fits_and_darkens(browser: &Browser) {
    let ground = || browser.run("return getComputedStyle(document.body).backgroundColor;");
    for (name, width, dark) in [("desktop", 1280, false), ("phone", 390, false), ("dark", 1280, true)] {
        browser.emulate(width, 900, dark);
        let overflow = browser.run("return document.documentElement.scrollWidth - window.innerWidth;");
        assert!(overflow.as_i64().is_some_and(|pixels| pixels <= 0), "{name}: {overflow} pixels too wide");
        let expected = if dark { "rgb(20, 24, 29)" } else { "rgb(255, 255, 255)" };
        assert_eq!(ground(), expected, "{name}");
        let picture = browser.screenshot();
        let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("report-{name}.png.base64"));
        std::fs::write(&path, picture).expect("the build folder is writable");
    }
    let charts = browser.run("return document.querySelectorAll('figure svg text').length;");
    assert!(charts.as_i64().is_some_and(|n| n > 100), "{charts} words in the pictures");
}
