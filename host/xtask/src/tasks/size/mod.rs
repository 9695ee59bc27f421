//! `size`: what each firmware image takes, held against its budget.

mod budget;
mod report;

use anyhow::{Context as _, Result, ensure};
use imagecheck::image::{self, ImageFigures, PlacedVariables};
use imagecheck::reach::{EntryKind, EntryPanics};
use imagecheck::stack::Level;

use self::budget::Budget;
use crate::console;
use crate::tasks::firmware::toolchain::Toolchain;
use crate::tasks::firmware::{self, Built, Image, boards};
use crate::workspace::Workspace;

/// Prints flash, static RAM, worst stack and calls of panics of each image, and holds its
/// budget.
///
/// Budgets stand in the board's Cargo.toml: [package.metadata.budget.IMAGE] with flash_bytes,
/// static_bytes, stack_bytes and panic_calls, and [[package.metadata.stack]] with the handlers
/// and tasks of each level of priority; and, where it matters, [[package.metadata.placed]] with
/// memory, addresses and names of what must be there. They are promises about the compiler that
/// firmware/boards/rust-toolchain.toml pins: with it an image over any of them is a failure, with
/// another a warning. One whose stack does not fit beside its variables is always a failure.
///
/// The worst stack is the longest chain of calls, from the code and the compiler's own stack
/// sizes, of the thread and of each level of interrupts on top of it. A call through a pointer
/// counts as the worst function of its kind to which there is a pointer. Recursion through
/// pointers is not seen.
#[derive(clap::Args, Default)]
#[command(
    after_help = "Examples:\n  cargo xtask size\n  cargo xtask size pico --stack    # which calls need the stack\n  cargo xtask size --json > sizes.json\n  cargo xtask size --write   # tests/bench/SIZES.md"
)]
pub(crate) struct Arguments {
    /// The boards; all of them if none is named.
    boards: Vec<String>,
    /// The compiler to use, rather than the first that is installed.
    #[arg(long)]
    toolchain: Option<Toolchain>,
    /// Lists the functions that could panic.
    #[arg(long)]
    panics: bool,
    /// Lists the longest chain of calls of each level of priority.
    #[arg(long)]
    stack: bool,
    /// Prints the figures as JSON.
    #[arg(long)]
    json: bool,
    /// Writes the table to tests/bench/SIZES.md too.
    #[arg(long)]
    write: bool,
}

impl Arguments {
    /// All boards, with this compiler or the first that is there.
    pub fn with(toolchain: Option<Toolchain>) -> Self {
        Self {
            toolchain,
            ..Self::default()
        }
    }
}

/// Builds the images that the arguments name, and holds their budgets.
pub fn run(workspace: &Workspace, arguments: &Arguments) -> Result<()> {
    let boards = boards::select(&arguments.boards)?;
    let Built { images, compiler } = firmware::build(workspace, &boards, arguments.toolchain)?;
    let packages = workspace.members(&firmware::manifest(workspace))?;
    let (mut over, mut unsound) = (Vec::new(), Vec::new());
    let mut rows = vec![
        [
            "image",
            "flash",
            "budget",
            "static",
            "budget",
            "stack",
            "budget",
            "room",
            "panics",
            "ours",
            "budget",
            "in interrupts",
            "budget",
        ]
        .map(String::from),
    ];
    let mut reachable = vec![["image", "what", "name", "panics"].map(String::from)];
    let mut json = Vec::new();
    for image in &images {
        let ImagePromise {
            budget,
            levels,
            placed,
        } = promised(&packages, image)?;
        let bytes = firmware::read(&image.elf)?;
        let figures = ImageFigures::read(&bytes, &levels, image.board.has_fpu())
            .with_context(|| format!("image `{}`", image.name))?;
        if arguments.stack {
            show_stack(image, &figures);
        }
        if arguments.panics {
            for (function, calls) in &figures.panics {
                console::progress(&format!("{calls:4}  {function}"));
            }
            show_reachable(image, &figures);
        }
        let of_image = |what: String| format!("{}: {what}", image.name);
        over.extend(budget.broken_by(&figures).map(of_image));
        unsound.extend(budget::unsound(&figures).map(of_image));
        unsound.extend(image::misplaced(&bytes, &placed)?.into_iter().map(of_image));
        rows.push([
            image.name.clone(),
            figures.flash_bytes.to_string(),
            budget.flash_bytes.to_string(),
            figures.static_bytes.to_string(),
            budget.static_bytes.to_string(),
            figures.stack_bytes().to_string(),
            budget.stack_bytes.to_string(),
            figures.room_bytes.to_string(),
            figures.panic_calls().to_string(),
            figures.own_panic_calls().to_string(),
            budget.panic_calls.to_string(),
            figures.interrupt_panic_calls().to_string(),
            budget.interrupt_panic_calls.to_string(),
        ]);
        reachable.extend(figures.reachable.iter().map(|entry| {
            let kind = match entry.kind {
                EntryKind::Interrupt => "interrupt",
                EntryKind::Task => "task",
            };
            let count = entry.count().to_string();
            [image.name.clone(), kind.into(), entry.name.clone(), count]
        }));
        json.push(serde_json::json!({
            "image": image.name,
            "flash_bytes": figures.flash_bytes,
            "static_bytes": figures.static_bytes,
            "stack_bytes": figures.stack_bytes(),
            "stack_room_bytes": figures.room_bytes,
            "panic_calls": figures.panic_calls(),
            "interrupt_panic_calls": figures.interrupt_panic_calls(),
        }));
    }
    if arguments.json {
        println!("{}", serde_json::to_string_pretty(&json)?);
    } else {
        console::rows(&rows);
    }
    if arguments.write {
        ensure!(
            compiler.is_pinned,
            "SIZES.md is about the pinned compiler, and this is {compiler}"
        );
        let file = workspace.root.join("tests/bench/SIZES.md");
        std::fs::write(&file, report::markdown(&rows, &reachable, &compiler))
            .with_context(|| format!("cannot write {}", file.display()))?;
    }
    for over in budget::hold(&compiler, over, &unsound)? {
        console::warning(&format!("not held with {}: {over}", compiler.version));
    }
    Ok(())
}

/// What the board's package says about an image.
struct ImagePromise {
    budget: Budget,
    levels: Vec<Level>,
    placed: Vec<PlacedVariables>,
}

fn promised(packages: &serde_json::Value, image: &Image) -> Result<ImagePromise> {
    let package = firmware::package(packages, image.board)?;
    let table = |path: &str| package.pointer(&format!("/metadata/{path}")).cloned();
    let name = format!("package.metadata.budget.{}", image.name);
    let budget = table(&format!("budget/{}", image.name))
        .with_context(|| format!("package `{}` has no {name}", image.board.package))?;
    let budget = serde_json::from_value(budget).with_context(|| name)?;
    let levels = table("stack").unwrap_or_else(|| serde_json::json!([]));
    let levels = serde_json::from_value(levels).context("package.metadata.stack")?;
    let placed = table("placed").unwrap_or_else(|| serde_json::json!([]));
    let mut placed: Vec<PlacedVariables> =
        serde_json::from_value(placed).context("package.metadata.placed")?;
    placed.retain(|placed| placed.image == image.name);
    Ok(ImagePromise {
        budget,
        levels,
        placed,
    })
}

fn show_reachable(image: &Image, figures: &ImageFigures) {
    let is_interrupt = |entry: &&EntryPanics| entry.kind == EntryKind::Interrupt;
    for entry in figures.reachable.iter().filter(is_interrupt) {
        console::headline(&format!(
            "{}: {} in {}",
            image.name,
            entry.count(),
            entry.name
        ));
        for (function, calls) in &entry.calls {
            console::progress(&format!("{calls:4}  {function}"));
        }
    }
}

fn show_stack(image: &Image, figures: &ImageFigures) {
    for need in &figures.stack {
        console::headline(&format!("{}: {} bytes", image.name, need.bytes));
        for (function, bytes) in &need.chain {
            console::progress(&format!("{bytes:7}  {function}"));
        }
    }
}
