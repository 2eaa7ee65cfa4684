//! The README's results, made from a result file.

use std::fs;
use std::path::Path;

use anyhow::{Context, bail};

use crate::{shell, splice};

/// Where the picture goes, from the root of the tree.
const PICTURE: &str = "docs/images/results.svg";

/// Replaces what stands between the markers of the README by the Markdown report of `file`, and the picture.
pub fn splice(file: &Path) -> anyhow::Result<()> {
    let root = shell::root();
    let file = fs::canonicalize(file).with_context(|| format!("cannot find {}", file.display()))?;
    let shown = file.strip_prefix(fs::canonicalize(&root)?).unwrap_or(&file).to_string_lossy().into_owned();
    let report = |format: &str| -> anyhow::Result<String> {
        let mut command =
            shell::cargo(&["run", "--release", "--quiet", "--package", "lapbench", "--", "report"]);
        let output = command.arg(&file).args(["--format", format]).output().context("cannot start cargo")?;
        if !output.status.success() {
            bail!("{}: {}", shell::line(&command), String::from_utf8_lossy(&output.stderr));
        }
        Ok(String::from_utf8(output.stdout)?)
    };
    let table = format!(
        "{}\n![Time of a solve or frame, by solver]({PICTURE})\n\nThe file with all figures and the environment: [`{shown}`]({shown}).\n",
        report("markdown")?
    );
    let picture = root.join(PICTURE);
    fs::write(&picture, report("svg")?).with_context(|| format!("cannot write {}", picture.display()))?;
    splice::into("README.md", "results", &table)
}
