//! `firmware-check`: what the firmware's crates promise, held on the targets.
//!
//! - They depend on nothing that knows an executor or hardware ([`dependencies`]).
//! - They compile for both bare-metal targets.
//! - They use no heap: `firmware/check` links them into an image that has no allocator,
//!   which does not link if any crate in it names `alloc`.
//! - The image stays within its budget of code and of places that could panic ([`Image`]).

mod dependencies;

use anyhow::{Context as _, Result, ensure};

use crate::console;
use crate::firmware::toolchain::{self, TARGETS, Toolchain};
use crate::house::{House, execute};
use crate::size::image::Image;

/// Builds the firmware's crates for the bare-metal targets and holds their promises.
///
/// No standard library, no heap, no executor or hardware in the brain, and an image that
/// stays within its budget (firmware/check/Cargo.toml). Takes rustup's targets if they are
/// installed, else Debian's compiler.
#[derive(clap::Args, Default)]
#[command(
    after_help = "Examples:\n  cargo xtask firmware-check\n  cargo xtask firmware-check --toolchain debian --panics"
)]
pub struct Arguments {
    /// The compiler to use, rather than the first that is installed.
    #[arg(long)]
    toolchain: Option<Toolchain>,
    /// Lists the functions that could panic.
    #[arg(long)]
    panics: bool,
}

/// The crate that links the others, and the name of its image.
const PACKAGE: &str = "umi-firmware-check";

/// The target and processor that the budget is for: a Cortex-M7 with a double-precision FPU.
const MEASURED: (&str, &str) = (TARGETS[0], "cortex-m7");

/// Checks, with the compiler that the arguments ask for, or the first that is there.
pub fn run(house: &House, arguments: &Arguments) -> Result<()> {
    let toolchain = toolchain::choose(house, arguments.toolchain)?;
    dependencies::check(house)?;
    console::progress("dependencies: no executor, no hardware, no std, no heap");
    let image = build_all(house, toolchain)?;
    if arguments.panics {
        for (function, calls) in &image.panics {
            console::progress(&format!("{calls:4}  {function}"));
        }
    }
    Budget::of(&house.members(&house.root.join("Cargo.toml"))?)?.hold(&image)
}

/// Builds for every target, and returns the figures of the measured image.
fn build_all(house: &House, toolchain: Toolchain) -> Result<Image> {
    console::progress(&format!("building with {toolchain}"));
    let mut measured = Image::default();
    for target in TARGETS {
        let cpu = (target == MEASURED.0).then_some(MEASURED.1);
        let image = build(house, toolchain, target, cpu)?;
        let place = cpu.unwrap_or(target);
        console::progress(&format!(
            "{place}: {} bytes of code, {} of constants, {} of variables; \
             {} calls of panics, {} of them in functions of ours",
            image.text,
            image.constants,
            image.variables,
            image.panic_calls(),
            image.own_panic_calls(),
        ));
        if cpu.is_some() {
            measured = image;
        }
    }
    Ok(measured)
}

fn build(house: &House, toolchain: Toolchain, target: &str, cpu: Option<&str>) -> Result<Image> {
    execute(
        toolchain
            .cargo(house, target, cpu)
            .args(["build", "--profile=firmware", "--package", PACKAGE])
            .args(toolchain.build_arguments(target)),
    )?;
    let file = house
        .target
        .join("firmware")
        .join("build")
        .join(target)
        .join("firmware")
        .join(PACKAGE);
    let bytes = std::fs::read(&file).with_context(|| format!("cannot read {}", file.display()))?;
    Image::read(&bytes)
}

/// What the measured image may hold at most: `package.metadata.budget` of `firmware/check`.
#[derive(Debug, PartialEq, Eq)]
struct Budget {
    text_bytes: u64,
    variables_bytes: u64,
    panic_calls: u64,
}

impl Budget {
    fn of(metadata: &serde_json::Value) -> Result<Self> {
        let packages = metadata.get("packages").and_then(|value| value.as_array());
        let package = packages
            .into_iter()
            .flatten()
            .find(|package| package.get("name").is_some_and(|name| name == PACKAGE))
            .with_context(|| format!("the workspace has no member {PACKAGE}"))?;
        let figure = |name: &str| {
            package
                .pointer("/metadata/budget")
                .and_then(|budget| budget.get(name))
                .and_then(|figure| figure.as_u64())
                .with_context(|| format!("{PACKAGE} has no package.metadata.budget.{name}"))
        };
        Ok(Self {
            text_bytes: figure("text_bytes")?,
            variables_bytes: figure("variables_bytes")?,
            panic_calls: figure("panic_calls")?,
        })
    }

    fn hold(&self, image: &Image) -> Result<()> {
        let held = [
            ("bytes of code", image.text, self.text_bytes),
            ("bytes of variables", image.variables, self.variables_bytes),
            (
                "calls of panics (--panics lists them)",
                u64::from(image.panic_calls()),
                self.panic_calls,
            ),
        ];
        for (what, figure, budget) in held {
            ensure!(
                figure <= budget,
                "the image has {figure} {what}, over its budget of {budget}: go below it, or \
                 raise package.metadata.budget in firmware/check/Cargo.toml and say why"
            );
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;

    /// A budget is read from the package, and an image over any part of it is refused.
    #[test]
    fn budget_is_held() {
        let metadata = serde_json::json!({"packages": [{
            "name": PACKAGE,
            "metadata": {"budget": {"text_bytes": 100, "variables_bytes": 10, "panic_calls": 2}},
        }]});
        let budget = Budget::of(&metadata).unwrap();
        let image = |text, variables, calls| Image {
            text,
            variables,
            panics: BTreeMap::from([("f".to_owned(), calls)]),
            ..Image::default()
        };
        assert!(budget.hold(&image(100, 10, 2)).is_ok());
        for (over, says) in [
            (image(101, 10, 2), "101 bytes of code"),
            (image(100, 11, 2), "11 bytes of variables"),
            (image(100, 10, 3), "3 calls of panics"),
        ] {
            let error = budget.hold(&over).unwrap_err().to_string();
            assert!(error.contains(says), "{error}");
        }
    }

    /// A budget that is not there is an error, not a budget without limits.
    #[test]
    fn missing_budget_is_an_error() {
        let metadata = serde_json::json!({"packages": [{"name": PACKAGE, "metadata": null}]});
        assert!(Budget::of(&metadata).is_err());
    }
}
