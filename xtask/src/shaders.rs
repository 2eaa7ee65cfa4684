//! Compiles the Vulkan shaders to SPIR-V. The result is committed, so that a build needs no compiler; the tests here see
//! to it that sources and SPIR-V belong together.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail, ensure};
use sha2::{Digest, Sha256};

use crate::shell;

/// The compiler whose bytes are committed: another version may give other bytes for the same program.
const COMPILER: &str = "Glslang Version: 11:12.0.0";
/// Hashes of sources and SPIR-V, beside the sources.
const MANIFEST: &str = "MANIFEST";

/// One kernel compiled for one kind of number and one way of reading.
struct Variant {
    source: PathBuf,
    /// Such as `forward.f64.texel`.
    name: String,
    defines: Vec<String>,
}

fn folder() -> PathBuf {
    shell::root().join("solvers/src/backends/vulkan/shaders")
}

/// Compiles all variants into `shaders/spv` and writes the manifest.
pub fn regenerate() -> anyhow::Result<()> {
    let version = compiler_version()?;
    ensure!(
        version == COMPILER,
        "glslangValidator says `{version}`, but the pinned compiler is `{COMPILER}`"
    );
    let target = folder().join("spv");
    if target.is_dir() {
        fs::remove_dir_all(&target)?;
    }
    fs::create_dir_all(&target)?;
    for variant in variants()? {
        compile(&variant, &target.join(format!("{}.spv", variant.name)))?;
    }
    fs::write(folder().join(MANIFEST), manifest()?)?;
    eprintln!("xtask: compiled {} shaders", variants()?.len());
    Ok(())
}

/// All variants, by name. A source names its own in a line `// variants: REAL.READ ...`.
fn variants() -> anyhow::Result<Vec<Variant>> {
    let mut all = Vec::new();
    for source in files(&folder(), "comp")? {
        let text = fs::read_to_string(&source)?;
        let line = text.lines().find_map(|line| line.strip_prefix("// variants:"));
        let list = line.with_context(|| format!("{}: no line `// variants: ...`", source.display()))?;
        let stem = source.file_stem().unwrap_or_default().to_string_lossy();
        for variant in list.split_whitespace() {
            let Some((real, read)) = variant.split_once('.') else {
                bail!("{}: `{variant}` is not REAL.READ", source.display())
            };
            all.push(Variant {
                name: format!("{stem}.{variant}"),
                defines: vec![format!("-DREAL_{real}"), format!("-DREAD_{read}")],
                source: source.clone(),
            });
        }
    }
    Ok(all)
}

fn compile(variant: &Variant, to: &Path) -> anyhow::Result<()> {
    let mut command = shell::command("glslangValidator", &["--quiet", "-V", "--target-env", "vulkan1.1"]);
    command.args(&variant.defines).arg("-o").arg(to).arg(&variant.source);
    let line = shell::line(&command);
    let output = command.output().with_context(|| format!("cannot start: {line}"))?;
    ensure!(output.status.success(), "{line}\n{}", String::from_utf8_lossy(&output.stdout));
    Ok(())
}

fn compiler_version() -> anyhow::Result<String> {
    let output = shell::command("glslangValidator", &["--version"])
        .output()
        .context("glslangValidator is missing (Debian, Ubuntu: glslang-tools)")?;
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    Ok(text.lines().next().unwrap_or_default().to_owned())
}

/// One line per file, `sha256  name`, after a line that names the compiler.
fn manifest() -> anyhow::Result<String> {
    let mut text = format!("# cargo xtask shaders, {COMPILER}\n");
    let sources = files(&folder(), "glsl")?.into_iter().chain(files(&folder(), "comp")?);
    for path in sources.chain(files(&folder().join("spv"), "spv")?) {
        let digest = Sha256::digest(fs::read(&path)?);
        let hash: String = digest.iter().map(|byte| format!("{byte:02x}")).collect();
        text += &format!("{hash}  {}\n", path.strip_prefix(folder())?.display());
    }
    Ok(text)
}

/// Files in `folder` with this extension, sorted.
fn files(folder: &Path, extension: &str) -> anyhow::Result<Vec<PathBuf>> {
    let entries = fs::read_dir(folder).with_context(|| folder.display().to_string())?;
    let paths = entries.map(|entry| entry.map(|entry| entry.path())).collect::<Result<Vec<_>, _>>()?;
    let mut paths: Vec<_> =
        paths.into_iter().filter(|path| path.extension().is_some_and(|e| e == extension)).collect();
    paths.sort();
    Ok(paths)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sources_and_spirv_are_those_of_the_manifest() {
        let committed = fs::read_to_string(folder().join(MANIFEST)).unwrap();
        assert_eq!(committed, manifest().unwrap(), "run `cargo xtask shaders` after a change of a shader");
    }

    #[test]
    fn every_variant_has_its_spirv_and_no_other_lies_there() {
        let mut names: Vec<_> = variants().unwrap().into_iter().map(|v| v.name + ".spv").collect();
        names.sort();
        let there = files(&folder().join("spv"), "spv").unwrap();
        let there: Vec<_> =
            there.iter().map(|p| p.file_name().unwrap().to_string_lossy().into_owned()).collect();
        assert_eq!(names, there);
    }

    #[test]
    fn the_pinned_compiler_gives_the_committed_bytes() {
        match compiler_version() {
            Ok(version) if version == COMPILER => {}
            other => return skip(&format!("needs {COMPILER}, found {other:?}")),
        }
        let scratch = std::env::temp_dir().join(format!("lapsolve-shader-{}.spv", std::process::id()));
        for variant in variants().unwrap() {
            compile(&variant, &scratch).unwrap();
            let committed = folder().join(format!("spv/{}.spv", variant.name));
            assert!(fs::read(&scratch).unwrap() == fs::read(committed).unwrap(), "{}", variant.name);
        }
        fs::remove_file(&scratch).unwrap();
    }

    /// A skip is printed, and is a failure where the Vulkan tests are required.
    fn skip(reason: &str) {
        let required = std::env::var("LAPBENCH_REQUIRE").unwrap_or_default();
        let required = required.split(',').any(|word| ["all", "1", "vulkan"].contains(&word.trim()));
        assert!(!required, "LAPBENCH_REQUIRE forbids to skip: {reason}");
        println!("SKIPPED the_pinned_compiler_gives_the_committed_bytes: {reason}");
    }
}
