//! The README's results, made from a result file.

use std::fs;
use std::path::Path;

use anyhow::{Context, bail};

use crate::shell;

const BEGIN: &str = "<!-- results:begin -->";
const END: &str = "<!-- results:end -->";

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
    let readme = root.join("README.md");
    let text = fs::read_to_string(&readme).context("cannot read README.md")?;
    fs::write(&readme, between(&text, &table)?).context("cannot write README.md")?;
    eprintln!("xtask: README.md and {PICTURE} show {shown}");
    Ok(())
}

/// `text` with what stands between the markers replaced.
fn between(text: &str, content: &str) -> anyhow::Result<String> {
    let (Some(begin), Some(end)) = (text.find(BEGIN), text.find(END)) else {
        bail!("README.md lacks {BEGIN} or {END}");
    };
    if end < begin {
        bail!("README.md has {END} before {BEGIN}");
    }
    Ok(format!("{}\n{content}{}", &text[..begin + BEGIN.len()], &text[end..]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_is_between_the_markers_changes() {
        let text = format!("a\n{BEGIN}\nold\n{END}\nb\n");
        let spliced = between(&text, "new\n").unwrap();
        assert_eq!(spliced, format!("a\n{BEGIN}\nnew\n{END}\nb\n"));
        assert_eq!(between(&spliced, "new\n").unwrap(), spliced);
        assert!(between("no markers", "").is_err() && between(&format!("{END}{BEGIN}"), "").is_err());
    }
}
