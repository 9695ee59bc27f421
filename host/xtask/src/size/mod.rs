//! `size`: what each firmware image takes, held against its budget.

pub mod image;
mod memory;
mod program;
mod report;
mod stack;
mod thumb;

use anyhow::{Context as _, Result, bail};
use serde::Deserialize;

use self::image::Figures;
use self::stack::Level;
use crate::console;
use crate::firmware::toolchain::Toolchain;
use crate::firmware::{self, Image, boards};
use crate::house::House;

/// Prints flash, static RAM, worst stack and calls of panics of each image, and holds its
/// budget.
///
/// Budgets stand in the board's Cargo.toml: [package.metadata.budget.IMAGE] with flash_bytes,
/// static_bytes, stack_bytes and panic_calls, and [[package.metadata.stack]] with the handlers
/// and tasks of each level of priority. An image over any of them, or one whose stack does not
/// fit beside its variables, is a failure.
///
/// The worst stack is the longest chain of calls, from the code and the compiler's own stack
/// sizes, of the thread and of each level of interrupts on top of it. A call through a pointer
/// counts as the worst function of its kind to which there is a pointer. Recursion through
/// pointers is not seen.
#[derive(clap::Args, Default)]
#[command(
    after_help = "Examples:\n  cargo xtask size\n  cargo xtask size pico --stack    # which calls need the stack\n  cargo xtask size --json > sizes.json\n  cargo xtask size mps2-an500 pico pico2 nucleo-h743 --write   # tests/bench/SIZES.md"
)]
pub struct Arguments {
    /// The boards; all of them but the pico2 if none is named.
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

/// What an image may take at most.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct Budget {
    flash_bytes: u64,
    static_bytes: u64,
    stack_bytes: u64,
    panic_calls: u64,
}

/// Builds the images that the arguments name, and holds their budgets.
pub fn run(house: &House, arguments: &Arguments) -> Result<()> {
    let boards = boards::select(&arguments.boards)?;
    let images = firmware::build(house, &boards, arguments.toolchain)?;
    let packages = house.members(&firmware::manifest(house))?;
    let mut over = Vec::new();
    let mut rows = vec![
        [
            "image", "flash", "budget", "static", "budget", "stack", "budget", "room", "panics",
            "ours", "budget",
        ]
        .map(String::from),
    ];
    let mut json = Vec::new();
    for image in &images {
        let (budget, levels) = promised(&packages, image)?;
        let bytes = firmware::read(&image.elf)?;
        let figures = Figures::read(&bytes, &levels, image.board.has_fpu())
            .with_context(|| format!("image `{}`", image.name))?;
        if arguments.stack {
            show_stack(image, &figures);
        }
        if arguments.panics {
            for (function, calls) in &figures.panics {
                console::progress(&format!("{calls:4}  {function}"));
            }
        }
        over.extend(
            budget
                .broken_by(&figures)
                .map(|what| format!("{}: {what}", image.name)),
        );
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
        ]);
        json.push(serde_json::json!({
            "image": image.name,
            "flash_bytes": figures.flash_bytes,
            "static_bytes": figures.static_bytes,
            "stack_bytes": figures.stack_bytes(),
            "stack_room_bytes": figures.room_bytes,
            "panic_calls": figures.panic_calls(),
        }));
    }
    if arguments.json {
        println!("{}", serde_json::to_string_pretty(&json)?);
    } else {
        console::rows(&rows);
    }
    if arguments.write {
        let file = house.root.join("tests/bench/SIZES.md");
        std::fs::write(&file, report::markdown(&rows))
            .with_context(|| format!("cannot write {}", file.display()))?;
    }
    if !over.is_empty() {
        bail!(
            "over budget; go below it, or raise it in the board's Cargo.toml and say why:\n  {}",
            over.join("\n  ")
        );
    }
    Ok(())
}

impl Budget {
    /// What of the budget the image does not keep.
    fn broken_by(&self, figures: &Figures) -> impl Iterator<Item = String> {
        let stack = figures.stack_bytes();
        let held = [
            ("bytes of flash", figures.flash_bytes, self.flash_bytes),
            (
                "bytes of static RAM",
                figures.static_bytes,
                self.static_bytes,
            ),
            (
                "bytes of stack (--stack shows the calls)",
                stack,
                self.stack_bytes,
            ),
            (
                "calls of panics (--panics lists them)",
                figures.panic_calls().into(),
                self.panic_calls,
            ),
        ];
        let over = held
            .into_iter()
            .filter(|(_, figure, budget)| figure > budget);
        let no_room = stack > figures.room_bytes;
        over.map(|(what, figure, budget)| format!("{figure} {what}, budget {budget}"))
            .chain(no_room.then(|| {
                format!(
                    "{stack} bytes of stack, where {} are left beside the variables",
                    figures.room_bytes
                )
            }))
            .chain(figures.unbounded.iter().map(|name| {
                format!(
                    "the stack of `{name}` is not known: it moves the stack pointer by a register"
                )
            }))
    }
}

/// What the board's package says about an image.
fn promised(packages: &serde_json::Value, image: &Image) -> Result<(Budget, Vec<Level>)> {
    let package = firmware::package(packages, image.board)?;
    let table = |path: &str| package.pointer(&format!("/metadata/{path}")).cloned();
    let name = format!("package.metadata.budget.{}", image.name);
    let budget = table(&format!("budget/{}", image.name))
        .with_context(|| format!("package `{}` has no {name}", image.board.package))?;
    let budget = serde_json::from_value(budget).with_context(|| name)?;
    let levels = table("stack").unwrap_or_else(|| serde_json::json!([]));
    let levels = serde_json::from_value(levels).context("package.metadata.stack")?;
    Ok((budget, levels))
}

fn show_stack(image: &Image, figures: &Figures) {
    for need in &figures.stack {
        console::headline(&format!("{}: {} bytes", image.name, need.bytes));
        for (function, bytes) in &need.chain {
            console::progress(&format!("{bytes:7}  {function}"));
        }
    }
}
