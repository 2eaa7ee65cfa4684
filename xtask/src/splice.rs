//! Tables that a command makes, put between two markers of a Markdown file.

use std::fs;

use anyhow::{Context, bail};

use crate::shell;

/// Replaces what stands between `<!-- name:begin -->` and `<!-- name:end -->` in `file` of the tree.
pub fn into(file: &str, name: &str, content: &str) -> anyhow::Result<()> {
    let path = shell::root().join(file);
    let text = fs::read_to_string(&path).with_context(|| format!("cannot read {file}"))?;
    let spliced = between(&text, name, content).with_context(|| file.to_owned())?;
    fs::write(&path, spliced).with_context(|| format!("cannot write {file}"))?;
    eprintln!("xtask: {file} shows {name}");
    Ok(())
}

/// `text` with what stands between the markers replaced.
fn between(text: &str, name: &str, content: &str) -> anyhow::Result<String> {
    let [begin, end] = ["begin", "end"].map(|side| format!("<!-- {name}:{side} -->"));
    let (Some(from), Some(to)) = (text.find(&begin), text.find(&end)) else {
        bail!("it lacks {begin} or {end}");
    };
    if to < from {
        bail!("it has {end} before {begin}");
    }
    Ok(format!("{}\n{content}{}", &text[..from + begin.len()], &text[to..]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_is_between_the_markers_changes() {
        let text = "a\n<!-- x:begin -->\nold\n<!-- x:end -->\nb\n";
        let spliced = between(text, "x", "new\n").unwrap();
        assert_eq!(spliced, "a\n<!-- x:begin -->\nnew\n<!-- x:end -->\nb\n");
        assert_eq!(between(&spliced, "x", "new\n").unwrap(), spliced);
        assert!(between(text, "y", "").is_err());
        assert!(between("<!-- x:end --><!-- x:begin -->", "x", "").is_err());
    }
}
