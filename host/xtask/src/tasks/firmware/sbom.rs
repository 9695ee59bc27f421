//! `sbom`: what an image and the tool are made of, as CycloneDX 1.5.
//!
//! The packages are those that cargo compiles in for this target with these features (`cargo tree`),
//! with the check values of the lock file. What runs on the building machine only (procedural macros
//! and what they need) is named as `excluded`. The bytes of an image stand in it as SHA-256 and
//! SHA-512. The same sources give the same file: it has no date and no random number.
//!
//! # Limitations
//!
//! What a package brings along as C source is not looked into; the images have none.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, ensure};
use serde_json::{Value, json};
use sha2::{Digest as _, Sha256, Sha512};

use super::{Image, boards, build, manifest, read};
use crate::console;
use crate::workspace::{Workspace, output};

/// Writes what the images and `umi` are made of, as CycloneDX.
///
/// Builds the images of the boards that are named, and leaves IMAGE.cdx.json for each beside it in
/// target/firmware, and umi.cdx.json for the tool.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  cargo xtask sbom\n  cargo xtask sbom pico")]
pub(crate) struct Arguments {
    /// The boards; all of them if none is named.
    boards: Vec<String>,
}

/// Writes the lists.
pub fn run(workspace: &Workspace, arguments: &Arguments) -> Result<()> {
    let boards = boards::select(&arguments.boards)?;
    let images = build(workspace, &boards, None)?.images;
    let boards_lock = manifest(workspace).with_file_name("Cargo.lock");
    let checksums = checksums(&boards_lock)?;
    let mut rows = vec![["of", "packages", "in it", "file"].map(String::from)];
    for image in &images {
        let tree = of_image(workspace, image)?;
        let parts = Parts::read(&tree)?;
        let hashed = hashed(&read(&image.elf)?);
        let list = parts.list(&image.name, "firmware", &checksums, Some(&hashed))?;
        rows.push(put(
            &image.elf.with_extension("cdx.json"),
            &image.name,
            &parts,
            &list,
        )?);
    }
    let own = checksums_of_tool(workspace)?;
    let parts = Parts::read(&of_tool(workspace)?)?;
    let list = parts.list("umi", "application", &own, None)?;
    fs::create_dir_all(workspace.firmware())?;
    let file = workspace.firmware().join("umi.cdx.json");
    rows.push(put(&file, "umi", &parts, &list)?);
    console::rows(&rows);
    Ok(())
}

/// What `umi` is built on, as cargo-auditable puts it into a program: its scheme is
/// <https://github.com/rust-secure-code/cargo-auditable/blob/master/cargo-auditable.schema.json>.
pub fn of_umi(workspace: &Workspace) -> Result<Value> {
    let parts = Parts::read(&of_tool(workspace)?)?;
    Ok(parts.auditable(&checksums_of_tool(workspace)?))
}

/// The names and versions of the lock file that `umi` is built by.
pub fn locked(workspace: &Workspace) -> Result<BTreeSet<PackageName>> {
    Ok(packages(&lock_of_tool(workspace))?
        .into_iter()
        .map(|(name, _)| name)
        .collect())
}

fn put(file: &Path, name: &str, parts: &Parts, list: &Value) -> Result<[String; 4]> {
    let text = serde_json::to_string_pretty(list)? + "\n";
    fs::write(file, text).with_context(|| format!("cannot write {}", file.display()))?;
    let shown = file.file_name().unwrap_or_default().to_string_lossy();
    Ok([
        name.to_owned(),
        parts.packages.len().to_string(),
        parts.linked.len().to_string(),
        shown.into_owned(),
    ])
}

const FORMAT: &str = "|{p}|{l}|{r}";

fn of_image(workspace: &Workspace, image: &Image) -> Result<String> {
    let board = image.board;
    let mut command = workspace.cargo();
    command
        .args([
            "tree",
            "--quiet",
            "--locked",
            "--edges=normal",
            "--prefix=depth",
        ])
        .args(["--format", FORMAT, "--target", board.target])
        .args(["--package", board.package, "--manifest-path"])
        .arg(manifest(workspace));
    if let Some(features) = board.features {
        command.args(["--no-default-features", "--features", features]);
    }
    output(&mut command)
}

fn of_tool(workspace: &Workspace) -> Result<String> {
    output(workspace.cargo().args([
        "tree",
        "--quiet",
        "--locked",
        "--edges=normal",
        "--prefix=depth",
        "--format",
        FORMAT,
        "--package",
        "umi",
    ]))
}

fn lock_of_tool(workspace: &Workspace) -> PathBuf {
    workspace.root.join("Cargo.lock")
}

fn checksums_of_tool(workspace: &Workspace) -> Result<BTreeMap<PackageName, String>> {
    checksums(&lock_of_tool(workspace))
}

/// SHA-256 and SHA-512 in hexadecimal digits.
fn hashed(bytes: &[u8]) -> [(&'static str, String); 2] {
    let hex = |bytes: &[u8]| bytes.iter().map(|byte| format!("{byte:02x}")).collect();
    [
        ("SHA-256", hex(&Sha256::digest(bytes))),
        ("SHA-512", hex(&Sha512::digest(bytes))),
    ]
}

/// Name and version.
pub type PackageName = (String, String);

/// The check value that a lock file has of each package.
fn checksums(lock: &Path) -> Result<BTreeMap<PackageName, String>> {
    let packages = packages(lock)?.into_iter();
    Ok(packages
        .filter_map(|(name, checksum)| Some((name, checksum?)))
        .collect())
}

/// The packages of a lock file, with the check value of those that a registry has.
fn packages(lock: &Path) -> Result<Vec<(PackageName, Option<String>)>> {
    let text =
        fs::read_to_string(lock).with_context(|| format!("cannot read {}", lock.display()))?;
    let lock: toml::Table = text.parse()?;
    let packages = lock.get("package").and_then(toml::Value::as_array);
    let packages = packages.context("a lock file lists packages")?;
    let text = |package: &toml::Value, key| Some(package.get(key)?.as_str()?.to_owned());
    Ok(packages
        .iter()
        .filter_map(|of| {
            let name = (text(of, "name")?, text(of, "version")?);
            Some((name, text(of, "checksum")))
        })
        .collect())
}

/// A package as cargo names it.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Package {
    licence: String,
    repository: String,
}

/// Packages, who needs whom, and which of them are in what is built.
#[derive(Debug)]
struct Parts {
    root: PackageName,
    packages: BTreeMap<PackageName, Package>,
    needs: BTreeMap<PackageName, BTreeSet<PackageName>>,
    linked: BTreeSet<PackageName>,
}

impl Parts {
    /// Reads what `cargo tree` says: a line for each package, with its depth before it.
    fn read(tree: &str) -> Result<Self> {
        let mut packages = BTreeMap::new();
        let mut needs: BTreeMap<PackageName, BTreeSet<PackageName>> = BTreeMap::new();
        let mut macros = BTreeSet::new();
        // Who stands above a line.
        let mut above: Vec<PackageName> = Vec::new();
        for line in tree.lines().filter(|line| !line.is_empty()) {
            let mut fields = line.trim_end_matches(" (*)").splitn(4, '|');
            let mut next = || fields.next().with_context(|| format!("no package: {line}"));
            let depth: usize = next()?.parse()?;
            let said = next()?;
            let mut words = said.split(' ');
            let mut word = || words.next().with_context(|| format!("no package: {line}"));
            let name = word()?.to_owned();
            let version = word()?.trim_start_matches('v').to_owned();
            let name = (name, version);
            let package = Package {
                licence: next()?.to_owned(),
                repository: next()?.to_owned(),
            };
            ensure!(depth <= above.len(), "a line below nothing: {line}");
            above.truncate(depth);
            if let Some(parent) = above.last() {
                needs
                    .entry(parent.clone())
                    .or_default()
                    .insert(name.clone());
            }
            if said.contains("(proc-macro)") {
                macros.insert(name.clone());
            }
            above.push(name.clone());
            packages.insert(name, package);
        }
        let root = tree.lines().next().context("cargo names no package")?;
        let root = root.split('|').nth(1).unwrap_or_default();
        let mut words = root
            .split(' ')
            .map(|word| word.trim_start_matches('v').to_owned());
        let root = words
            .next()
            .zip(words.next())
            .context("cargo names no package")?;
        let mut linked = BTreeSet::new();
        let mut due = vec![root.clone()];
        while let Some(name) = due.pop() {
            if !macros.contains(&name) && linked.insert(name.clone()) {
                due.extend(needs.get(&name).into_iter().flatten().cloned());
            }
        }
        Ok(Self {
            root,
            packages,
            needs,
            linked,
        })
    }

    /// The list, of what is called `name`.
    fn list(
        &self,
        name: &str,
        kind: &str,
        checksums: &BTreeMap<PackageName, String>,
        bytes: Option<&[(&'static str, String)]>,
    ) -> Result<Value> {
        let hash = |alg: &str, content: &str| json!({"alg": alg, "content": content});
        let reference = |(name, version): &PackageName| format!("pkg:cargo/{name}@{version}");
        let component = |of: &PackageName| {
            let Package {
                licence,
                repository,
            } = &self.packages[of];
            let mut component = json!({
                "type": "library",
                "bom-ref": reference(of),
                "name": of.0,
                "version": of.1,
                "purl": reference(of),
                "scope": if self.linked.contains(of) { "required" } else { "excluded" },
            });
            if !licence.is_empty() {
                // Before 2016 a slash stood for OR.
                let expression = licence.replace('/', " OR ");
                component["licenses"] = json!([{ "expression": expression }]);
            }
            if !repository.is_empty() {
                component["externalReferences"] = json!([{"type": "vcs", "url": repository}]);
            }
            if let Some(checksum) = checksums.get(of) {
                component["hashes"] = json!([hash("SHA-256", checksum)]);
            }
            component
        };
        let root = &self.root;
        let mut of = component(root);
        of["type"] = kind.into();
        of["name"] = name.into();
        if let Some(object) = of.as_object_mut() {
            object.remove("scope");
        }
        if let Some(bytes) = bytes {
            of["hashes"] = bytes
                .iter()
                .map(|(alg, content)| hash(alg, content))
                .collect();
        }
        let others = self.packages.keys().filter(|name| *name != root);
        let needs = self.packages.keys().map(|name| {
            let on = self.needs.get(name).into_iter().flatten().map(reference);
            json!({"ref": reference(name), "dependsOn": on.collect::<Vec<_>>()})
        });
        Ok(json!({
            "$schema": "http://cyclonedx.org/schema/bom-1.5.schema.json",
            "bomFormat": "CycloneDX",
            "specVersion": "1.5",
            "version": 1,
            "metadata": {"component": of},
            "components": others.map(component).collect::<Vec<_>>(),
            "dependencies": needs.collect::<Vec<_>>(),
        }))
    }
}

impl Parts {
    /// The list as cargo-auditable has it: who needs whom by places in the list.
    fn auditable(&self, checksums: &BTreeMap<PackageName, String>) -> Value {
        let places: BTreeMap<&PackageName, usize> = self.packages.keys().zip(0..).collect();
        let package = |of: &PackageName| {
            let needs = self.needs.get(of).into_iter().flatten();
            let needs: BTreeSet<usize> = needs.map(|of| places[of]).collect();
            json!({
                "name": of.0,
                "version": of.1,
                "source": if checksums.contains_key(of) { "crates.io" } else { "local" },
                "kind": if self.linked.contains(of) { "runtime" } else { "build" },
                "dependencies": needs,
                "root": *of == self.root,
            })
        };
        json!({"packages": self.packages.keys().map(package).collect::<Vec<_>>()})
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TREE: &str = "\
0|umi-pico v0.1.0 (/x/pico)|MIT OR Apache-2.0|https://example.org/umi
1|serde v1.0.2|MIT/Apache-2.0|https://example.org/serde
2|serde_derive v1.0.2 (proc-macro)|MIT|https://example.org/serde
3|syn v2.0.1|MIT|
1|umi-core v0.1.0 (/x/core)|MIT|
2|serde v1.0.2|MIT/Apache-2.0|https://example.org/serde (*)
";

    /// Each package stands there once, with who needs it; macros are not in the image.
    #[test]
    fn a_tree_becomes_a_list() {
        let parts = Parts::read(TREE).unwrap();
        assert_eq!(parts.packages.len(), 5);
        assert_eq!(parts.linked.len(), 3);
        let serde = ("serde".to_owned(), "1.0.2".to_owned());
        let sums = BTreeMap::from([(serde, "ab".to_owned())]);
        let list = parts
            .list("pico", "firmware", &sums, Some(&hashed(b"image")))
            .unwrap();
        assert_eq!(list["metadata"]["component"]["name"], "pico");
        let hashes = &list["metadata"]["component"]["hashes"];
        assert_eq!(hashes[1]["content"].as_str().unwrap().len(), 128);
        let components = list["components"].as_array().unwrap();
        assert_eq!(components.len(), 4);
        let of = |name: &str| components.iter().find(|of| of["name"] == name).unwrap();
        assert_eq!(of("serde")["scope"], "required");
        assert_eq!(of("serde")["hashes"][0]["content"], "ab");
        assert_eq!(
            of("serde")["licenses"][0]["expression"],
            "MIT OR Apache-2.0"
        );
        assert_eq!(of("syn")["scope"], "excluded");
        let needs = list["dependencies"].as_array().unwrap();
        let core = needs
            .iter()
            .find(|of| of["ref"] == "pkg:cargo/umi-core@0.1.0");
        assert_eq!(core.unwrap()["dependsOn"], json!(["pkg:cargo/serde@1.0.2"]));
        // serde, serde_derive, syn, umi-core, umi-pico.
        let told = parts.auditable(&sums);
        let told = told["packages"].as_array().unwrap();
        let of = |at: usize, key: &str| &told[at][key];
        assert_eq!(*of(0, "source"), "crates.io");
        assert_eq!(*of(0, "dependencies"), json!([1]));
        assert_eq!(
            (of(1, "kind"), of(3, "kind")),
            (&json!("build"), &json!("runtime"))
        );
        assert_eq!(*of(4, "dependencies"), json!([0, 3]));
        assert_eq!(
            (of(4, "root"), of(4, "source")),
            (&json!(true), &json!("local"))
        );
        assert!(told.iter().filter(|of| of["root"] == true).count() == 1);
    }
}
