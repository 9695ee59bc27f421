//! What work costs a board, in instructions: the image `mps2-an500-figures` in QEMU.

use std::fmt::Write as _;

use anyhow::{Context as _, Result, ensure};

use crate::console;
use crate::tasks::firmware::{self, boards};
use crate::workspace::{Workspace, find_program, output};

const QEMU: &str = "qemu-system-arm";
const BOARD: &str = "mps2-an500";
const IMAGE: &str = "mps2-an500-figures";

/// What work costs.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct Cost {
    /// What is done.
    pub work: String,
    /// Instructions of one unit.
    pub instructions: u64,
}

/// Runs the board's figures; none, with a reason told, where that cannot be.
pub fn costs(workspace: &Workspace) -> Result<Option<Vec<Cost>>> {
    if find_program(QEMU).is_none() {
        console::skipped(&format!(
            "instructions on a board: no {QEMU}; `cargo xtask set-up` brings it"
        ));
        return Ok(None);
    }
    let images = firmware::build(workspace, &[boards::find(BOARD)?], None)?.images;
    let image = images
        .iter()
        .find(|image| image.name == IMAGE)
        .with_context(|| format!("{BOARD} has no image {IMAGE}"))?;
    console::progress("counting instructions on a Cortex-M7");
    let printed = output(
        workspace
            .command(QEMU)
            .args(["-M", BOARD, "-display", "none", "-nodefaults"])
            // An instruction takes a nanosecond, which the image counts.
            .args(["-icount", "shift=0"])
            .args(["-semihosting-config", "enable=on,target=native", "-kernel"])
            .arg(&image.elf),
    )?;
    read(&printed).map(Some)
}

/// The lines `work UNITS INSTRUCTIONS WORK`.
fn read(printed: &str) -> Result<Vec<Cost>> {
    let costs: Vec<Cost> = printed
        .lines()
        .filter_map(|line| line.strip_prefix("work "))
        .map(|line| {
            let parts: Vec<&str> = line.splitn(3, ' ').collect();
            let [units, all, work] = parts[..] else {
                anyhow::bail!("`{line}` is no work");
            };
            let (units, all): (u64, u64) = (units.parse()?, all.parse()?);
            ensure!(units > 0, "`{line}` is no work");
            Ok(Cost {
                work: work.to_owned(),
                instructions: all / units,
            })
        })
        .collect::<Result<_>>()?;
    ensure!(!costs.is_empty(), "{IMAGE} has counted nothing");
    Ok(costs)
}

/// The section of the page.
pub fn markdown(costs: &[Cost]) -> String {
    let mut section = String::from(
        "\n## On a board\n\n\
         | work | instructions on a Cortex-M7 |\n\
         |---|---:|\n",
    );
    for Cost { work, instructions } in costs {
        let _ = writeln!(section, "| {work} | {instructions} |");
    }
    section.push_str(
        "\nCounted by QEMU's clock, of which an instruction takes a nanosecond: the same image \
         gives the same count. The image is built as a board's is, for size, with a \
         double-precision FPU. A real Cortex-M7 does up to two of them in a cycle, and waits for \
         memory. `tests/tests/boards/qemu/figures.rs` holds the budgets. What the images take of flash \
         and RAM is in [SIZES.md](SIZES.md).\n",
    );
    section
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What the image prints is read, and what is no count is refused.
    #[test]
    fn work_is_read() {
        let costs = read("fit a b c\nwork 20 1000 a sphere\nwork 1 7 a plate\n").unwrap();
        let cost = |work: &str, instructions| Cost {
            work: work.into(),
            instructions,
        };
        assert_eq!(costs, [cost("a sphere", 50), cost("a plate", 7)]);
        assert!(markdown(&costs).contains("| a sphere | 50 |\n| a plate | 7 |\n"));
        for none in [
            "",
            "fit a b c\n",
            "work 1 2\n",
            "work 0 2 x\n",
            "work x 2 x\n",
        ] {
            assert!(read(none).is_err(), "{none}");
        }
    }
}
