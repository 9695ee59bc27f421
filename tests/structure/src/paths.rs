//! Which file's code names what other files declare.

use std::collections::BTreeSet;
use std::path::PathBuf;

use proc_macro2::{TokenStream, TokenTree};
use syn::visit::{self, Visit};

use crate::module::{Module, Tree, flatten, is_test};

/// Follows of re-exports, at most: two that name each other have no end.
const HOPS: u32 = 16;

/// A file names what another declares.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Lean {
    /// Whose code it is.
    pub from: PathBuf,
    /// Who declares it.
    pub to: PathBuf,
    /// The path as it is written.
    pub path: String,
}

/// All that a crate's files name of each other.
#[must_use]
pub fn leans(tree: &Tree) -> BTreeSet<Lean> {
    let mut leans = BTreeSet::new();
    for (at, module) in &tree.modules {
        let mut paths = Paths::default();
        for item in &module.code {
            paths.visit_item(item);
        }
        paths.found.extend(module.private_imports.iter().cloned());
        for path in paths.found {
            let Some(to) = declared(tree, at, &path, HOPS) else {
                continue;
            };
            let is_one_room = at.starts_with(&to) || to.starts_with(at);
            if let Some(target) = tree.modules.get(&to)
                && !is_one_room
                && target.file != module.file
            {
                leans.insert(Lean {
                    from: module.file.clone(),
                    to: target.file.clone(),
                    path: path.join("::"),
                });
            }
        }
    }
    leans
}

/// The module that declares what a path means in this module. None: another crate, a local
/// name, or a module, which is no item.
fn declared(tree: &Tree, at: &[String], path: &[String], hops: u32) -> Option<Vec<String>> {
    let hops = hops.checked_sub(1)?;
    let mut at = at.to_vec();
    let mut rest = path;
    let mut is_first = true;
    while let Some((segment, after)) = rest.split_first() {
        let module = tree.modules.get(&at)?;
        match segment.as_str() {
            "crate" if is_first => at.clear(),
            "self" if is_first => {}
            "super" => drop(at.pop()?),
            name => {
                let below: Vec<String> = at.iter().cloned().chain([name.to_owned()]).collect();
                if tree.modules.contains_key(&below) {
                    at = below;
                } else if module.items.contains(name) {
                    return Some(at);
                } else {
                    return imported(tree, module, &at, name, after, hops);
                }
            }
        }
        is_first = false;
        rest = after;
    }
    None
}

fn imported(
    tree: &Tree,
    module: &Module,
    at: &[String],
    name: &str,
    after: &[String],
    hops: u32,
) -> Option<Vec<String>> {
    if let Some(target) = module.imports.get(name) {
        let path: Vec<String> = target.iter().chain(after).cloned().collect();
        // `use x::x;` names another crate's item, not itself.
        return (target.first().map(String::as_str) != Some(name) || target.len() > 1)
            .then(|| declared(tree, at, &path, hops))?;
    }
    module.globs.iter().find_map(|glob| {
        let path: Vec<String> = glob
            .iter()
            .cloned()
            .chain([name.to_owned()])
            .chain(after.iter().cloned())
            .collect();
        declared(tree, at, &path, hops)
    })
}

/// Collects the paths that code names.
#[derive(Default)]
struct Paths {
    found: BTreeSet<Vec<String>>,
}

impl Visit<'_> for Paths {
    fn visit_path(&mut self, path: &syn::Path) {
        let segments = path.segments.iter().map(|of| of.ident.to_string());
        self.found.insert(segments.collect());
        visit::visit_path(self, path);
    }

    fn visit_item(&mut self, item: &syn::Item) {
        if !is_test(crate::module::attributes(item)) {
            visit::visit_item(self, item);
        }
    }

    fn visit_item_use(&mut self, import: &syn::ItemUse) {
        // One within a function.
        let mut found = Vec::new();
        flatten(&import.tree, &mut Vec::new(), &mut found);
        self.found.extend(found.into_iter().map(|(_, path)| path));
    }

    fn visit_macro(&mut self, of: &syn::Macro) {
        visit::visit_macro(self, of);
        self.tokens(of.tokens.clone());
    }

    fn visit_vis_restricted(&mut self, _: &syn::VisRestricted) {
        // `pub(in path)` and `pub(super)` lean on nobody.
    }
}

impl Paths {
    /// Paths in the arguments of a macro: names with `::` between them.
    fn tokens(&mut self, tokens: TokenStream) {
        let mut path: Vec<String> = Vec::new();
        let mut colons = 0;
        for token in tokens {
            match token {
                TokenTree::Ident(name) => {
                    if colons != 2 {
                        self.found.insert(core::mem::take(&mut path));
                    }
                    colons = 0;
                    path.push(name.to_string());
                }
                TokenTree::Punct(mark) if mark.as_char() == ':' => colons += 1,
                TokenTree::Group(group) => {
                    self.tokens(group.stream());
                    colons = 0;
                    self.found.insert(core::mem::take(&mut path));
                }
                _ => {
                    colons = 0;
                    self.found.insert(core::mem::take(&mut path));
                }
            }
        }
        self.found.insert(path);
        self.found.remove(&Vec::new());
    }
}
