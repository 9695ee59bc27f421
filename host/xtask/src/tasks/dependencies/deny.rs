//! Dependencies: licences, sources, bans and advisories, by cargo-deny.
//!
//! The rules stand in `deny.toml`. Advisories come from a snapshot of RustSec's database in
//! `tests/supply-chain`: the answer is the same without a network, and one commit gives the same
//! answer every day. cargo-deny clones its database with git, so the snapshot becomes a
//! repository in the target directory, and git is told that the database is there.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, ensure};

use crate::tasks::{bench, firmware};
use crate::tools::emulators;
use crate::workspace::{Workspace, execute, output};

/// Where cargo-deny would fetch its database.
const DATABASE: &str = "https://github.com/RustSec/advisory-db";

/// Holds the rules for every package of every lock file.
pub fn check(workspace: &Workspace) -> Result<()> {
    let folder = workspace.target.join("xtask").join("advisories");
    if folder.exists() {
        fs::remove_dir_all(&folder)?;
    }
    let database = folder.join("snapshot");
    unpack(workspace, &database)?;
    let rules = rules(workspace)?;
    let config = folder.join("deny.toml");
    fs::write(
        &config,
        with_database(rules.clone(), &folder.join("clone"))?,
    )?;
    let manifests = [
        workspace.root.join("Cargo.toml"),
        bench::manifest(workspace),
        firmware::manifest(workspace),
    ];
    for manifest in manifests {
        execute(
            workspace
                .cargo()
                .args(["deny", "--log-level=error", "--manifest-path"])
                .arg(manifest)
                .arg("--config")
                .arg(&config)
                .args(["check", "--hide-inclusion-graph"])
                .env("GIT_CONFIG_COUNT", "1")
                .env(
                    "GIT_CONFIG_KEY_0",
                    format!("url.file://{}.insteadOf", database.display()),
                )
                .env("GIT_CONFIG_VALUE_0", DATABASE),
        )?;
    }
    let lock = emulators::folder(workspace).join("package-lock.json");
    let lock =
        fs::read_to_string(&lock).with_context(|| format!("cannot read {}", lock.display()))?;
    let refused = of_npm(&serde_json::from_str(&lock)?, &allowed(&rules)?)?;
    ensure!(
        refused.is_empty(),
        "packages of npm whose licence is not among those that deny.toml allows:\n  {}",
        refused.join("\n  ")
    );
    Ok(())
}

fn rules(workspace: &Workspace) -> Result<toml::Table> {
    let file = workspace.root.join("deny.toml");
    let text =
        fs::read_to_string(&file).with_context(|| format!("cannot read {}", file.display()))?;
    text.parse()
        .with_context(|| format!("{} is no TOML", file.display()))
}

/// The rules, with their database in this folder rather than in the user's own.
fn with_database(mut rules: toml::Table, folder: &Path) -> Result<String> {
    let advisories = rules
        .get_mut("advisories")
        .and_then(toml::Value::as_table_mut);
    let advisories = advisories.context("deny.toml has no [advisories]")?;
    let folder = folder
        .to_str()
        .context("the target directory's path is no UTF-8")?;
    advisories.insert("db-path".into(), folder.into());
    Ok(toml::to_string(&rules)?)
}

/// Makes a git repository of the snapshot.
fn unpack(workspace: &Workspace, folder: &Path) -> Result<()> {
    fs::create_dir_all(folder)?;
    let snapshot: PathBuf = workspace.root.join("tests/supply-chain/advisory-db.tar.gz");
    output(
        workspace
            .command("tar")
            .arg("-xzf")
            .arg(snapshot)
            .arg("-C")
            .arg(folder),
    )?;
    let git = |arguments: &[&str]| {
        output(
            workspace
                .command("git")
                .args([
                    "-c",
                    "user.name=openumi",
                    "-c",
                    "user.email=openumi@localhost",
                ])
                .args([
                    "-c",
                    "commit.gpgsign=false",
                    "-c",
                    "core.hooksPath=/dev/null",
                ])
                .args(arguments)
                .current_dir(folder),
        )
    };
    git(&["init", "--quiet"])?;
    git(&["checkout", "--quiet", "-B", "main"])?;
    git(&["add", "--all"])?;
    git(&["commit", "--quiet", "--message", "snapshot"])?;
    Ok(())
}

/// The licences that deny.toml allows.
fn allowed(rules: &toml::Table) -> Result<Vec<String>> {
    let list = rules.get("licenses").and_then(|table| table.get("allow"));
    let list = list.and_then(toml::Value::as_array);
    let list = list.context("deny.toml allows no licences")?;
    Ok(list
        .iter()
        .filter_map(|it| it.as_str().map(String::from))
        .collect())
}

/// The packages of a `package-lock.json` whose licences are not allowed. One that names
/// several is allowed if one of them is.
fn of_npm(lock: &serde_json::Value, allowed: &[String]) -> Result<Vec<String>> {
    let packages = lock.get("packages").and_then(|list| list.as_object());
    let packages = packages.context("package-lock.json lists no packages")?;
    let refused = packages
        .iter()
        .filter_map(|(path, package)| {
            let licence = package["license"].as_str().unwrap_or("");
            let name = path
                .rsplit_once("node_modules/")
                .map_or("(ours)", |(_, name)| name);
            let is_allowed = licence
                .split(" OR ")
                .any(|one| allowed.iter().any(|allowed| allowed == one));
            (!is_allowed).then(|| format!("{name}: `{licence}`"))
        })
        .collect();
    Ok(refused)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A package of npm without a licence, or with one that is not allowed, is named.
    #[test]
    fn npm() {
        let lock = serde_json::json!({"packages": {
            "": {"license": "MIT OR Apache-2.0"},
            "node_modules/rp2040js": {"license": "MIT"},
            "node_modules/a/node_modules/@b/c": {"license": "GPL-3.0-only"},
            "node_modules/d": {},
        }});
        let allowed = ["MIT".to_owned()];
        assert_eq!(
            of_npm(&lock, &allowed).unwrap(),
            ["@b/c: `GPL-3.0-only`", "d: ``"]
        );
        assert!(of_npm(&serde_json::json!({}), &allowed).is_err());
    }

    /// The rules say which licences are allowed, and take a database's place.
    #[test]
    fn rules_of_the_project() {
        let rules: toml::Table = include_str!("../../../../../deny.toml").parse().unwrap();
        let allowed = allowed(&rules).unwrap();
        assert!(allowed.iter().any(|it| it == "MIT"), "{allowed:?}");
        assert!(allowed.iter().all(|it| !it.contains("GPL")), "{allowed:?}");
        let config = with_database(rules, Path::new("/somewhere")).unwrap();
        let config: toml::Table = config.parse().unwrap();
        assert_eq!(config["advisories"]["db-path"].as_str(), Some("/somewhere"));
        assert!(
            !config["advisories"]["ignore"]
                .as_array()
                .unwrap()
                .is_empty()
        );
    }
}
