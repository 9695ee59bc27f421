//! Dependencies that a package names and its code does not.
//!
//! A word of the dependency's name in any of the package's Rust files counts as use, as with
//! cargo-machete, whose list of exceptions it takes: `[package.metadata.cargo-machete]`, for
//! what is there to be linked or for its features. It is quick and needs no installation; it
//! does not see a dependency that only a comment mentions.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use anyhow::{Context as _, Result, ensure};

use crate::tasks::{bench, firmware};
use crate::workspace::Workspace;

/// Holds that every package of ours uses what it depends on.
pub fn check(workspace: &Workspace) -> Result<()> {
    let manifests = [
        workspace.root.join("Cargo.toml"),
        bench::manifest(workspace),
        firmware::manifest(workspace),
    ];
    let mut unused = Vec::new();
    for manifest in manifests {
        let members = workspace.members(&manifest)?;
        let packages = members["packages"].as_array();
        for package in packages.context("cargo metadata lists no packages")? {
            unused.extend(of_package(package)?);
        }
    }
    ensure!(
        unused.is_empty(),
        "dependencies that nothing uses; remove them, or give the reason in \
         [package.metadata.cargo-machete]:\n  {}",
        unused.join("\n  ")
    );
    Ok(())
}

fn of_package(package: &serde_json::Value) -> Result<Vec<String>> {
    let manifest = package["manifest_path"].as_str().map(Path::new);
    let folder = manifest.and_then(Path::parent);
    let mut words = BTreeSet::new();
    read_words(folder.context("a package has no folder")?, true, &mut words)?;
    Ok(named_only(package, &words))
}

/// The dependencies of a package whose code has these words, but for its exceptions.
fn named_only(package: &serde_json::Value, words: &BTreeSet<String>) -> Vec<String> {
    let list = |value: &serde_json::Value| value.as_array().cloned().unwrap_or_default();
    let ignored = list(&package["metadata"]["cargo-machete"]["ignored"]);
    list(&package["dependencies"])
        .iter()
        .filter_map(|dependency| {
            let name = dependency["rename"].as_str();
            let name = name.or(dependency["name"].as_str())?;
            let is_used = words.contains(&name.replace('-', "_"));
            let is_ignored = ignored.iter().any(|ignored| ignored == name);
            (!is_used && !is_ignored)
                .then(|| format!("{}: {name}", package["name"].as_str().unwrap_or_default()))
        })
        .collect()
}

/// The words of all Rust files in a folder, but for other packages in it.
fn read_words(folder: &Path, is_package: bool, words: &mut BTreeSet<String>) -> Result<()> {
    if !is_package && folder.join("Cargo.toml").is_file() {
        return Ok(());
    }
    for entry in fs::read_dir(folder).with_context(|| format!("{}", folder.display()))? {
        let path = entry?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        if path.is_dir() {
            if !name.starts_with('.') && name != "target" && name != "node_modules" {
                read_words(&path, false, words)?;
            }
        } else if name.ends_with(".rs") {
            let text = fs::read_to_string(&path)
                .with_context(|| format!("cannot read {}", path.display()))?;
            let is_word = |letter: char| letter.is_alphanumeric() || letter == '_';
            words.extend(text.split(|letter| !is_word(letter)).map(String::from));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A dependency is used by its name as code writes it, or by the name that it was given;
    /// one that is there for another reason is an exception.
    #[test]
    fn used_and_unused() {
        let package = serde_json::json!({
            "name": "ours",
            "dependencies": [
                {"name": "umi-core", "rename": null},
                {"name": "serde_json", "rename": "json"},
                {"name": "left-over", "rename": null},
                {"name": "linked", "rename": null},
            ],
            "metadata": {"cargo-machete": {"ignored": ["linked"]}},
        });
        let words = ["use", "umi_core", "json"].map(String::from).into();
        assert_eq!(named_only(&package, &words), ["ours: left-over"]);
        let words = ["umi_core", "serde_json", "left_over"]
            .map(String::from)
            .into();
        assert_eq!(named_only(&package, &words), ["ours: json"]);
    }
}
