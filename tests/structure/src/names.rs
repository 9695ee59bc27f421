//! The types that a crate makes public.

use std::path::PathBuf;

use syn::{Ident, Item, Visibility};

use crate::module::Tree;

/// A public type and the file that declares it.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct TypeName {
    /// Its name.
    pub name: String,
    /// Its file.
    pub file: PathBuf,
}

/// The types, traits and aliases that are `pub` where they are declared.
#[must_use]
pub fn types(tree: &Tree) -> Vec<TypeName> {
    let mut types = Vec::new();
    for module in tree.modules.values() {
        let public = module.code.iter().filter_map(public);
        types.extend(public.map(|ident| TypeName {
            name: ident.to_string(),
            file: module.file.clone(),
        }));
    }
    types
}

fn public(item: &Item) -> Option<&Ident> {
    let (visibility, ident) = match item {
        Item::Enum(item) => (&item.vis, &item.ident),
        Item::Struct(item) => (&item.vis, &item.ident),
        Item::Trait(item) => (&item.vis, &item.ident),
        Item::Type(item) => (&item.vis, &item.ident),
        Item::Union(item) => (&item.vis, &item.ident),
        _ => return None,
    };
    matches!(visibility, Visibility::Public(_)).then_some(ident)
}
