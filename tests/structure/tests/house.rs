//! The house has an order: nothing leans on what leans on it, and a name means one thing.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use umi_structure::{Crate, Lean, Tree, circles, crates, leans, types};

/// The repository's folder.
fn top() -> PathBuf {
    let top = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    top.canonicalize().expect("it is there")
}

/// The module trees of all crates.
fn trees(top: &Path) -> impl Iterator<Item = Tree> {
    let roots: Vec<PathBuf> = crates(top)
        .iter()
        .flat_map(umi_structure::Crate::roots)
        .collect();
    roots.into_iter().map(|root| Tree::read(&root))
}

/// No crate needs one that needs it, for its tests neither.
#[test]
fn no_circle_of_crates() {
    let crates = crates(&top());
    assert!(crates.len() > 10, "found {crates:?}");
    let arrows = crates
        .iter()
        .map(|of| (of.name.clone(), of.needs.iter().cloned().collect()))
        .collect();
    assert_eq!(circles(&arrows), Vec::<Vec<String>>::new());
}

/// Which crates of the repository a crate of the product may name. Each of them stands further
/// down in the list.
const ARROWS: &[(&str, &str)] = &[
    (
        "umi",
        "experiment report scan desk virtual kinematics client app core protocol",
    ),
    (
        "experiment",
        "report desk scan virtual kinematics client core protocol",
    ),
    ("report", "client core protocol"),
    ("desk", "virtual kinematics client core protocol"),
    ("virtual", "scan kinematics app core protocol"),
    ("scan", "sparse kinematics client core protocol"),
    ("client", "app core protocol"),
    ("kinematics", "core protocol"),
    ("drivers", "app core protocol"),
    ("app", "core protocol"),
    ("core", "protocol"),
    ("sparse", ""),
    ("protocol", ""),
];

/// Every crate of the product names those that it may, and no others of the product.
#[test]
fn crates_name_those_below_them() {
    let place = |name: &str| ARROWS.iter().position(|(from, _)| *from == name);
    for (from, targets) in ARROWS {
        for to in targets.split(' ').filter(|to| !to.is_empty()) {
            assert!(
                place(from) < place(to),
                "{from} -> {to} does not point down"
            );
        }
    }
    let crates = crates(&top());
    let short = |name: &str| name.strip_prefix("umi-").unwrap_or(name).to_owned();
    let mut found = 0;
    for of in &crates {
        let Some(at) = place(&short(&of.name)) else {
            continue;
        };
        found += 1;
        let (from, allowed) = ARROWS[at];
        for to in of.needs.iter().map(|name| short(name)) {
            let is_ours = place(&to).is_some();
            assert!(
                !is_ours || allowed.split(' ').any(|name| name == to),
                "{from} -> {to} is not drawn"
            );
        }
    }
    assert_eq!(found, ARROWS.len(), "a crate of the list is gone");
}

/// No file names what a file declares that names what it declares, also not by way of others.
#[test]
fn no_circle_of_files() {
    let top = top();
    let mut text = String::new();
    let mut files = 0;
    for tree in trees(&top) {
        let leans = leans(&tree);
        let mut arrows: BTreeMap<PathBuf, BTreeSet<PathBuf>> = BTreeMap::new();
        for Lean { from, to, .. } in &leans {
            arrows.entry(from.clone()).or_default().insert(to.clone());
        }
        files += arrows.len();
        for circle in circles(&arrows) {
            let name = |file: &Path| {
                file.strip_prefix(&top)
                    .unwrap_or(file)
                    .display()
                    .to_string()
            };
            let _ = writeln!(text, "a circle of {} files:", circle.len());
            for lean in &leans {
                if circle.contains(&lean.from) && circle.contains(&lean.to) {
                    let (from, to) = (name(&lean.from), name(&lean.to));
                    let _ = writeln!(text, "  {from} -> {to}: {}", lean.path);
                }
            }
        }
    }
    assert!(files > 150, "read {files} files only");
    assert!(text.is_empty(), "{text}");
}

/// Modules beside each other make no circle, where all that a module contains counts as it.
#[test]
fn no_circle_of_modules() {
    let mut found = Vec::new();
    let mut rooms = 0;
    for tree in trees(&top()) {
        // A file's own module is the outermost that stands in it.
        let modules = tree.modules.iter().rev();
        let at: BTreeMap<&Path, &[String]> = modules
            .map(|(path, module)| (module.file.as_path(), path.as_slice()))
            .collect();
        let mut arrows: BTreeMap<&[String], BTreeSet<&[String]>> = BTreeMap::new();
        for Lean { from, to, .. } in &leans(&tree) {
            let (from, to) = (at[from.as_path()], at[to.as_path()]);
            let shared = from.iter().zip(to).take_while(|(a, b)| a == b).count();
            if let (Some(from), Some(to)) = (from.get(..=shared), to.get(..=shared)) {
                arrows.entry(from).or_default().insert(to);
            }
        }
        rooms += arrows.len();
        for circle in circles(&arrows) {
            let names: Vec<String> = circle.iter().map(|path| path.join("::")).collect();
            found.push(names.join(", "));
        }
    }
    assert!(rooms > 150, "read {rooms} modules only");
    assert_eq!(found, Vec::<String>::new());
}

/// Folders of source that are wider than a reader takes in at a glance, and how wide they are.
/// None may join them, and none may grow.
const WIDE: &[(&str, usize)] = &[
    ("firmware/core/src", 20),
    ("host/scan/src", 19),
    ("host/scan/src/plan", 14),
];

/// A folder of source has a dozen entries at most.
#[test]
fn a_folder_is_narrow() {
    let top = top();
    let mut wide = Vec::new();
    let mut folders = 0;
    for tree in trees(&top) {
        let files = tree.modules.values().map(|module| module.file.as_path());
        let seen: BTreeSet<&Path> = files.filter_map(Path::parent).collect();
        folders += seen.len();
        for folder in seen {
            let entries = std::fs::read_dir(folder).expect("it has a module").count();
            let name = folder.strip_prefix(&top).expect("it is below the top");
            if entries > 12 {
                wide.push((name.display().to_string().replace('\\', "/"), entries));
            }
        }
    }
    wide.sort();
    wide.dedup();
    let standing: Vec<_> = WIDE
        .iter()
        .map(|(name, n)| ((*name).to_owned(), *n))
        .collect();
    assert!(folders > 100, "read {folders} folders only");
    assert_eq!(
        wide, standing,
        "give what is new a room; or strike off the list what is narrower"
    );
}

/// A public type's name is that of no other in the product. A board's may be another board's:
/// only one of them is in an image.
#[test]
fn a_name_is_one_type() {
    let top = top();
    let is_board = |of: &Crate| of.folder.starts_with(top.join("firmware/boards"));
    let is_product = |of: &Crate| !of.folder.starts_with(top.join("tests"));
    let (boards, shared): (Vec<Crate>, Vec<Crate>) = crates(&top)
        .into_iter()
        .filter(is_product)
        .partition(is_board);
    let declared = |of: &Crate| -> BTreeSet<(String, PathBuf)> {
        let trees = of.roots().into_iter().map(|root| Tree::read(&root));
        let types = trees.flat_map(|tree| types(&tree));
        types.map(|of| (of.name, of.file)).collect()
    };
    let shared: BTreeSet<_> = shared.iter().flat_map(declared).collect();
    assert!(shared.len() > 400, "found {} types", shared.len());
    let mut doubles = String::new();
    // First all that is shared, then each board with it.
    for board in std::iter::once(None).chain(boards.iter().map(Some)) {
        let own = board.map(declared).unwrap_or_default();
        let mut files: BTreeMap<&str, BTreeSet<&Path>> = BTreeMap::new();
        for (name, file) in own.iter().chain(&shared) {
            files.entry(name).or_default().insert(file);
        }
        for (name, files) in files {
            let is_new = board.is_none() || own.iter().any(|(of, _)| of == name);
            if files.len() > 1 && is_new {
                let _ = writeln!(doubles, "{name}: {files:#?}");
            }
        }
    }
    assert!(doubles.is_empty(), "{doubles}");
}

/// A crate of three files, of which two name each other, one of them by a re-export and in a
/// macro's arguments; the module that contains them is no part of it.
#[test]
fn a_circle_is_found() {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("circle");
    std::fs::create_dir_all(&folder).expect("a folder");
    let write = |name: &str, text: &str| {
        let path = folder.join(name);
        std::fs::write(&path, text).expect("a file");
        path
    };
    let root = write(
        "lib.rs",
        "mod a; mod b; mod c; pub use b::B; pub struct Top;",
    );
    write(
        "a.rs",
        "use super::B; pub struct A(B, crate::Top); impl A { pub const N: u32 = 1; }",
    );
    write("c.rs", "use crate::a::A; pub fn c(_: A) {}");
    for (text, is_circle) in [
        (
            "pub struct B; fn b() { assert_eq!(crate::a::A::N, 1); }",
            true,
        ),
        (
            "pub struct B; #[cfg(test)] mod tests { use crate::a::A; }",
            false,
        ),
    ] {
        write("b.rs", text);
        let mut arrows: BTreeMap<PathBuf, BTreeSet<PathBuf>> = BTreeMap::new();
        for Lean { from, to, .. } in leans(&Tree::read(&root)) {
            arrows.entry(from).or_default().insert(to);
        }
        let found: Vec<Vec<String>> = circles(&arrows)
            .iter()
            .map(|circle| {
                let names = circle.iter().filter_map(|file| file.file_stem());
                names
                    .map(|name| name.to_string_lossy().into_owned())
                    .collect()
            })
            .collect();
        let expected: &[[&str; 2]] = if is_circle { &[["a", "b"]] } else { &[] };
        assert_eq!(found, expected, "{text}");
    }
}
