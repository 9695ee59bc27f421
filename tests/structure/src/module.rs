//! A crate's modules as its source declares them, without its tests.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use syn::{Attribute, Item, UseTree, Visibility};

/// A module: its file, what it declares, what it imports.
#[derive(Default)]
pub struct Module {
    /// The file in which it stands.
    pub file: PathBuf,
    /// Names of its items and submodules.
    pub items: BTreeSet<String>,
    /// Names that it imports or re-exports, and the path of each.
    pub imports: BTreeMap<String, Vec<String>>,
    /// Paths of which it imports everything.
    pub globs: Vec<Vec<String>>,
    /// Imports that are no re-exports.
    pub private_imports: Vec<Vec<String>>,
    /// Its items but for modules, tests and imports.
    pub code: Vec<Item>,
}

/// A crate's modules by their paths; the root's is empty.
#[derive(Default)]
pub struct Tree {
    /// The modules.
    pub modules: BTreeMap<Vec<String>, Module>,
}

impl Tree {
    /// Reads the tree that begins at this file.
    ///
    /// # Panics
    /// A file that cannot be read or is no Rust, or a module without a file.
    #[must_use]
    pub fn read(root: &Path) -> Self {
        let mut tree = Self::default();
        let folder = root.parent().unwrap_or(Path::new("")).to_owned();
        tree.file(root, &folder, Vec::new());
        tree
    }

    fn file(&mut self, file: &Path, folder: &Path, path: Vec<String>) {
        let text = std::fs::read_to_string(file)
            .unwrap_or_else(|error| panic!("{}: {error}", file.display()));
        let parsed =
            syn::parse_file(&text).unwrap_or_else(|error| panic!("{}: {error}", file.display()));
        self.module(file, folder, path, parsed.items);
    }

    fn module(&mut self, file: &Path, folder: &Path, path: Vec<String>, items: Vec<Item>) {
        let mut module = Module {
            file: file.to_owned(),
            ..Module::default()
        };
        for item in items {
            if is_test(attributes(&item)) {
                continue;
            }
            if let Some(name) = name(&item) {
                module.items.insert(name);
            }
            match item {
                Item::Mod(inner) => {
                    let name = inner.ident.to_string();
                    let mut path = path.clone();
                    path.push(name.clone());
                    let below = folder.join(&name);
                    match inner.content {
                        Some((_, items)) => self.module(file, &below, path, items),
                        None => {
                            let beside = folder.join(format!("{name}.rs"));
                            let here = file.parent().unwrap_or(Path::new(""));
                            let file = match said(&inner.attrs) {
                                Some(said) => here.join(said),
                                None if beside.is_file() => beside,
                                None => below.join("mod.rs"),
                            };
                            let file = file.canonicalize().unwrap_or(file);
                            self.file(&file, &below, path);
                        }
                    }
                }
                Item::Use(import) => {
                    let is_private = matches!(import.vis, Visibility::Inherited);
                    let mut found = Vec::new();
                    flatten(&import.tree, &mut Vec::new(), &mut found);
                    for (name, target) in found {
                        if is_private {
                            module.private_imports.push(target.clone());
                        }
                        match name {
                            Some(name) => drop(module.imports.insert(name, target)),
                            None => module.globs.push(target),
                        }
                    }
                }
                item => module.code.push(item),
            }
        }
        self.modules.insert(path, module);
    }
}

/// A use tree's leaves: the name that each brings, none for a star, and its path.
pub(crate) fn flatten(
    tree: &UseTree,
    before: &mut Vec<String>,
    found: &mut Vec<(Option<String>, Vec<String>)>,
) {
    match tree {
        UseTree::Path(path) => {
            before.push(path.ident.to_string());
            flatten(&path.tree, before, found);
            before.pop();
        }
        UseTree::Name(name) if name.ident == "self" => {
            found.push((before.last().cloned(), before.clone()));
        }
        UseTree::Name(name) => {
            let name = name.ident.to_string();
            let path = before.iter().chain([&name]).cloned().collect();
            found.push((Some(name), path));
        }
        UseTree::Rename(rename) => {
            let mut path = before.clone();
            if rename.ident != "self" {
                path.push(rename.ident.to_string());
            }
            found.push((Some(rename.rename.to_string()), path));
        }
        UseTree::Glob(_) => found.push((None, before.clone())),
        UseTree::Group(group) => {
            for tree in &group.items {
                flatten(tree, before, found);
            }
        }
    }
}

/// The file that `#[path = "…"]` names.
fn said(attributes: &[Attribute]) -> Option<String> {
    let path = attributes.iter().find(|of| of.path().is_ident("path"))?;
    let syn::Expr::Lit(literal) = &path.meta.require_name_value().ok()?.value else {
        return None;
    };
    match &literal.lit {
        syn::Lit::Str(text) => Some(text.value()),
        _ => None,
    }
}

/// Whether an item is compiled for tests only.
pub(crate) fn is_test(attributes: &[Attribute]) -> bool {
    attributes.iter().any(|attribute| {
        attribute.path().is_ident("cfg")
            && attribute
                .parse_args::<syn::Ident>()
                .is_ok_and(|ident| ident == "test")
    })
}

pub(crate) fn attributes(item: &Item) -> &[Attribute] {
    match item {
        Item::Const(item) => &item.attrs,
        Item::Enum(item) => &item.attrs,
        Item::Fn(item) => &item.attrs,
        Item::Impl(item) => &item.attrs,
        Item::Macro(item) => &item.attrs,
        Item::Mod(item) => &item.attrs,
        Item::Static(item) => &item.attrs,
        Item::Struct(item) => &item.attrs,
        Item::Trait(item) => &item.attrs,
        Item::Type(item) => &item.attrs,
        Item::Union(item) => &item.attrs,
        Item::Use(item) => &item.attrs,
        _ => &[],
    }
}

fn name(item: &Item) -> Option<String> {
    let ident = match item {
        Item::Const(item) => &item.ident,
        Item::Enum(item) => &item.ident,
        Item::Fn(item) => &item.sig.ident,
        Item::Macro(item) => item.ident.as_ref()?,
        Item::Mod(item) => &item.ident,
        Item::Static(item) => &item.ident,
        Item::Struct(item) => &item.ident,
        Item::Trait(item) => &item.ident,
        Item::Type(item) => &item.ident,
        Item::Union(item) => &item.ident,
        _ => return None,
    };
    Some(ident.to_string())
}
