//! Dependencies: who has read them, by cargo-vet.
//!
//! What others have read, and why the rest is taken unread, stands in `tests/supply-chain`: a crate or a release that
//! nobody has read and that has no reason there fails. Nothing is fetched but what cargo itself needs.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use anyhow::{Context as _, Result, ensure};

use crate::tasks::firmware;
use crate::workspace::{Workspace, execute};

/// Holds the lists for what `umi` and the images are made of. The benchmarks' peers are in neither.
pub fn check(workspace: &Workspace) -> Result<()> {
    let lists = workspace.root.join("tests/supply-chain");
    let manifests = [
        ("host", workspace.root.join("Cargo.toml")),
        ("boards", firmware::manifest(workspace)),
    ];
    for (name, manifest) in manifests {
        let store = lists.join(name);
        let read = |file: &Path| {
            fs::read_to_string(file).with_context(|| format!("cannot read {}", file.display()))
        };
        let config = read(&store.join("config.toml"))?;
        let wrong = wrong(&config, &read(&manifest.with_file_name("Cargo.lock"))?)?;
        ensure!(
            wrong.is_empty(),
            "{}:\n  {}",
            store.join("config.toml").display(),
            wrong.join("\n  ")
        );
        execute(
            workspace
                .cargo()
                .args(["vet", "check", "--locked", "--manifest-path"])
                .arg(manifest)
                .arg("--store-path")
                .arg(store),
        )?;
    }
    Ok(())
}

/// The exemptions that have no reason, or that are of no crate in the lock file.
fn wrong(config: &str, lock: &str) -> Result<Vec<String>> {
    let text = |value: &toml::Value, field: &str| {
        let value = value.get(field).and_then(toml::Value::as_str);
        value.unwrap_or_default().to_owned()
    };
    let lock: toml::Table = lock.parse()?;
    let packages = lock.get("package").and_then(toml::Value::as_array);
    let used: BTreeSet<(String, String)> = packages
        .context("the lock file has no package")?
        .iter()
        .map(|package| (text(package, "name"), text(package, "version")))
        .collect();
    let config: toml::Table = config.parse()?;
    let exemptions = config.get("exemptions").and_then(toml::Value::as_table);
    let mut wrong = Vec::new();
    for (name, list) in exemptions.context("the list has no exemptions")? {
        for exemption in list.as_array().into_iter().flatten() {
            let version = text(exemption, "version");
            if text(exemption, "notes").is_empty() {
                wrong.push(format!(
                    "{name} {version}: say why it is taken unread, as `notes`"
                ));
            }
            if !used.contains(&(name.clone(), version.clone())) {
                wrong.push(format!(
                    "{name} {version}: nothing is made of it; take it out"
                ));
            }
        }
    }
    Ok(wrong)
}

#[cfg(test)]
mod tests {
    use super::wrong;

    /// A crate that is taken unread without a reason is named, and so is one that is not used any more.
    #[test]
    fn reasons() {
        let lock = "[[package]]\nname = \"a\"\nversion = \"1.0.0\"\n";
        let of = |exemptions: &str| wrong(exemptions, lock).unwrap();
        let good = "[[exemptions.a]]\nversion = \"1.0.0\"\nnotes = \"Small.\"\n";
        assert!(of(good).is_empty());
        let unread = of("[[exemptions.a]]\nversion = \"1.0.0\"\n");
        assert_eq!(unread, ["a 1.0.0: say why it is taken unread, as `notes`"]);
        let unused = of(&good.replace("1.0.0", "0.9.0"));
        assert_eq!(unused, ["a 0.9.0: nothing is made of it; take it out"]);
        assert!(wrong(good, "").is_err());
    }
}
