//! The crates of the repository and what each needs of the others.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// A package of the repository.
#[derive(Debug)]
pub struct Crate {
    /// Its name in its `Cargo.toml`.
    pub name: String,
    /// The folder of its `Cargo.toml`.
    pub folder: PathBuf,
    /// Packages that it names, for its code, its tests or its build script.
    pub needs: Vec<String>,
}

impl Crate {
    /// The files at which the crate's module trees begin: library and programs.
    #[must_use]
    pub fn roots(&self) -> Vec<PathBuf> {
        let source = self.folder.join("src");
        let mut roots: Vec<PathBuf> = ["lib.rs", "main.rs"]
            .iter()
            .map(|name| source.join(name))
            .collect();
        let programs = std::fs::read_dir(source.join("bin")).into_iter().flatten();
        roots.extend(programs.flatten().map(|entry| entry.path()));
        roots.retain(|path| path.is_file());
        roots
    }
}

/// All packages below a folder, in the order of their paths.
///
/// # Panics
/// A `Cargo.toml` that cannot be read.
#[must_use]
pub fn crates(top: &Path) -> Vec<Crate> {
    let mut found = BTreeMap::new();
    look(top, &mut found);
    found.into_values().collect()
}

fn look(folder: &Path, found: &mut BTreeMap<PathBuf, Crate>) {
    let manifest = folder.join("Cargo.toml");
    if let Ok(text) = std::fs::read_to_string(&manifest) {
        let table: toml::Table = text
            .parse()
            .unwrap_or_else(|error| panic!("{}: {error}", manifest.display()));
        if let Some(name) = table.get("package").and_then(|package| package.get("name")) {
            let needs = ["dependencies", "dev-dependencies", "build-dependencies"]
                .iter()
                .filter_map(|kind| table.get(*kind)?.as_table())
                .flat_map(|table| table.keys().cloned())
                .collect();
            let name = name.as_str().unwrap_or_default().to_owned();
            let folder = folder.to_owned();
            found.insert(
                folder.clone(),
                Crate {
                    name,
                    folder,
                    needs,
                },
            );
        }
    }
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    for entry in entries {
        let name = entry.file_name();
        let is_ours = name != "target" && !name.to_string_lossy().starts_with('.');
        if is_ours && entry.file_type().is_ok_and(|kind| kind.is_dir()) {
            look(&entry.path(), found);
        }
    }
}
