//! `--base-rev`: builds the program at a revision and in the working tree, with the same flags.

use anyhow::{Context, bail};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Base and head.
#[derive(Clone, Debug)]
pub struct Built {
    /// The program at the revision.
    pub base: PathBuf,
    /// The program of the working tree, if that was asked for.
    pub head: Option<PathBuf>,
}

/// Builds the package `lapbench` at `revision` and, `with_head`, as it stands in the working tree around the current folder. The
/// base is built in a work tree of its own below `target/gate`, which stays for the next time.
///
/// # Errors
/// No repository here, no such revision, or a build that fails; what git or cargo said is on stderr.
pub fn build(revision: &str, with_head: bool) -> anyhow::Result<Built> {
    let root = PathBuf::from(
        git(Path::new("."), &["rev-parse", "--show-toplevel"]).context("--base-rev needs a git checkout")?,
    );
    let name = format!("{revision}^{{commit}}");
    let commit =
        git(&root, &["rev-parse", "--verify", "--quiet", "--end-of-options", &name]).with_context(|| {
            format!("there is no revision `{revision}` here; fetch it (a shallow clone has few)")
        })?;
    let place = root.join("target").join("gate");
    let tree = place.join("base-tree");
    if tree.join(".git").exists() {
        git(&tree, &["checkout", "--quiet", "--force", "--detach", &commit])?;
    } else {
        std::fs::create_dir_all(&place).with_context(|| format!("cannot make {}", place.display()))?;
        git(&root, &["worktree", "prune"])?;
        let tree = tree.to_str().context("the path of this checkout is not UTF-8")?;
        git(&root, &["worktree", "add", "--quiet", "--force", "--detach", tree, &commit])?;
    }
    eprintln!("building base, {revision} = {commit}");
    let base = cargo(&tree, &place.join("base"))?;
    let mut head = None;
    if with_head {
        eprintln!("building head, the working tree");
        head = Some(cargo(&root, &place.join("head"))?);
    }
    Ok(Built { base, head })
}

/// Runs git in `folder`; its output without the line break.
fn git(folder: &Path, arguments: &[&str]) -> anyhow::Result<String> {
    let line = || format!("git {}", arguments.join(" "));
    let output = Command::new("git")
        .current_dir(folder)
        .args(arguments)
        .stderr(Stdio::inherit())
        .output()
        .with_context(|| format!("cannot start `{}`", line()))?;
    if !output.status.success() {
        bail!("`{}` failed", line());
    }
    Ok(String::from_utf8(output.stdout).with_context(line)?.trim().to_owned())
}

/// Builds in `folder` into `target`; the program.
fn cargo(folder: &Path, target: &Path) -> anyhow::Result<PathBuf> {
    let program = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let status = Command::new(program)
        .current_dir(folder)
        .args([
            "build",
            "--release",
            "--locked",
            "--package",
            "lapbench",
            "--bin",
            "lapbench",
            "--target-dir",
        ])
        .arg(target)
        .stdout(Stdio::null())
        .status()
        .context("cannot start cargo")?;
    if !status.success() {
        bail!("the build in {} failed", folder.display());
    }
    Ok(target.join("release").join(format!("lapbench{}", std::env::consts::EXE_SUFFIX)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn revisions_that_are_not_there_are_named() {
        let folder = tempfile::tempdir().unwrap();
        assert!(git(folder.path(), &["rev-parse", "--show-toplevel"]).is_err());
        let error = build("no-such-revision-anywhere", true).unwrap_err();
        let says = format!("{error:#}");
        assert!(says.contains("no-such-revision-anywhere") || says.contains("git checkout"), "{says}");
    }
}
