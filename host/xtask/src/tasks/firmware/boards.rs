//! The boards: one table of what each is built for and how it is flashed.

use anyhow::{Context as _, Result};

use super::uf2;

/// A board, or a variant of one.
#[derive(Debug)]
pub(crate) struct Board {
    /// What it is called here, and what its image is called in `target/firmware`.
    pub name: &'static str,
    /// Its package in `firmware/boards`.
    pub package: &'static str,
    /// The features that make the variant, instead of the package's default ones.
    pub features: Option<&'static str>,
    /// The compiler's target.
    pub target: &'static str,
    /// The processor, where the target's usual one is not meant.
    pub cpu: Option<&'static str>,
    /// How an image gets into it.
    pub flashing: Flashing,
    /// It is built when no board is named. A second chip with the sources of the first
    /// would make every build and check minutes longer.
    pub is_usual: bool,
}

impl Board {
    /// Whether the processor has a floating-point unit, whose registers interrupts save.
    pub fn has_fpu(&self) -> bool {
        self.target.ends_with("hf")
    }
}

/// How an image gets into a board.
#[derive(Debug)]
pub(crate) enum Flashing {
    /// It has no hardware: QEMU loads the image.
    Emulator,
    /// A debug probe, through probe-rs, which knows the chip by this name.
    Probe {
        /// `probe-rs chip list` has it.
        chip: &'static str,
    },
    /// A debug probe, or a file copied to the drive that its boot loader shows.
    ProbeOrDrive {
        /// `probe-rs chip list` has it.
        chip: &'static str,
        /// Who the file is for.
        family: uf2::Family,
    },
}

/// All boards.
pub const BOARDS: &[Board] = &[
    Board {
        name: "mps2-an500",
        package: "umi-mps2-an500",
        features: None,
        target: "thumbv7em-none-eabihf",
        cpu: Some("cortex-m7"),
        flashing: Flashing::Emulator,
        is_usual: true,
    },
    Board {
        name: "pico",
        package: "umi-pico",
        features: None,
        target: "thumbv6m-none-eabi",
        cpu: None,
        flashing: Flashing::ProbeOrDrive {
            chip: "RP2040",
            family: uf2::Family::Rp2040,
        },
        is_usual: true,
    },
    Board {
        name: "pico2",
        package: "umi-pico",
        features: Some("rp2350"),
        target: "thumbv8m.main-none-eabihf",
        cpu: None,
        flashing: Flashing::ProbeOrDrive {
            chip: "RP235x",
            family: uf2::Family::Rp2350,
        },
        is_usual: false,
    },
    Board {
        name: "nucleo-h743",
        package: "umi-nucleo-h743",
        features: None,
        target: "thumbv7em-none-eabihf",
        cpu: Some("cortex-m7"),
        flashing: Flashing::Probe {
            chip: "STM32H743ZITx",
        },
        is_usual: true,
    },
];

/// The boards that are built when none is named.
pub fn usual() -> impl Iterator<Item = &'static Board> {
    BOARDS.iter().filter(|board| board.is_usual)
}

/// The board of this name, or what names there are.
pub fn find(name: &str) -> Result<&'static Board> {
    BOARDS
        .iter()
        .find(|board| board.name == name)
        .with_context(|| {
            let names: Vec<&str> = BOARDS.iter().map(|board| board.name).collect();
            format!("no board `{name}`; there are: {}", names.join(", "))
        })
}

/// The boards of these names; all usual ones if none is named.
pub fn select(names: &[String]) -> Result<Vec<&'static Board>> {
    if names.is_empty() {
        return Ok(usual().collect());
    }
    names.iter().map(|name| find(name)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tasks::firmware::toolchain::TARGETS;

    /// The compiler is asked for every target that a board has, and names are unique.
    #[test]
    fn table_is_consistent() {
        for (index, board) in BOARDS.iter().enumerate() {
            assert!(TARGETS.contains(&board.target), "{}", board.name);
            assert!(BOARDS[..index].iter().all(|other| other.name != board.name));
        }
    }

    /// A wrong name is answered with the right ones; no name means all usual ones.
    #[test]
    fn names() {
        let error = select(&["pico3".into()]).unwrap_err().to_string();
        assert!(
            error.contains("`pico3`") && error.contains("pico2"),
            "{error}"
        );
        let all: Vec<&str> = select(&[])
            .unwrap()
            .iter()
            .map(|board| board.name)
            .collect();
        assert_eq!(all, ["mps2-an500", "pico", "nucleo-h743"]);
        assert_eq!(select(&["pico".into()]).unwrap()[0].package, "umi-pico");
    }
}
