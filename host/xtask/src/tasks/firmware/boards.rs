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
    /// The only binary that is built of the package; none: all.
    pub only: Option<&'static str>,
}

impl Board {
    /// The folder of its package in `firmware/boards`.
    pub fn folder(&self) -> &'static str {
        self.package.strip_prefix("umi-").unwrap_or(self.package)
    }

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
    /// As a part of a signed file ([`super::signed`]).
    Signed,
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
        only: None,
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
        only: None,
    },
    // What `cargo xtask firmware --sign` makes a file for the drive of: these alone do not start.
    Board {
        name: "pico-boot",
        package: "umi-pico",
        features: Some("rp2040,boot"),
        target: "thumbv6m-none-eabi",
        cpu: None,
        flashing: Flashing::Signed,
        only: Some("boot"),
    },
    Board {
        name: "pico-a",
        package: "umi-pico",
        features: Some("rp2040,slot-a"),
        target: "thumbv6m-none-eabi",
        cpu: None,
        flashing: Flashing::Signed,
        only: Some("umi-pico"),
    },
    Board {
        name: "pico-b",
        package: "umi-pico",
        features: Some("rp2040,slot-b"),
        target: "thumbv6m-none-eabi",
        cpu: None,
        flashing: Flashing::Signed,
        only: Some("umi-pico"),
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
        only: None,
    },
    // What `cargo xtask firmware pico2 --sign` makes a file for the drive of.
    Board {
        name: "pico2-ab",
        package: "umi-pico",
        features: Some("rp2350,slot-ab"),
        target: "thumbv8m.main-none-eabihf",
        cpu: None,
        flashing: Flashing::Signed,
        only: Some("umi-pico"),
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
        only: None,
    },
    // What `cargo xtask firmware nucleo-h743 --sign` makes one file of.
    Board {
        name: "nucleo-h743-boot",
        package: "umi-nucleo-h743",
        features: Some("boot"),
        target: "thumbv7em-none-eabihf",
        cpu: Some("cortex-m7"),
        flashing: Flashing::Signed,
        only: Some("boot"),
    },
    Board {
        name: "nucleo-h743-a",
        package: "umi-nucleo-h743",
        features: Some("slot-a"),
        target: "thumbv7em-none-eabihf",
        cpu: Some("cortex-m7"),
        flashing: Flashing::Signed,
        only: Some("umi-nucleo-h743"),
    },
    Board {
        name: "nucleo-h743-b",
        package: "umi-nucleo-h743",
        features: Some("slot-b"),
        target: "thumbv7em-none-eabihf",
        cpu: Some("cortex-m7"),
        flashing: Flashing::Signed,
        only: Some("umi-nucleo-h743"),
    },
];

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

/// What comes before a board's name where its self-test is meant: `selftest-pico`.
const SELF_TEST: &str = "selftest-";

/// What is to be built of a board.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Wanted {
    /// All its images.
    All,
    /// The one that tests the board.
    SelfTest,
}

/// The boards of these names, and what is wanted of each; all of all boards if none is named.
pub fn select_images(names: &[String]) -> Result<Vec<(&'static Board, Wanted)>> {
    if names.is_empty() {
        return Ok(BOARDS.iter().map(|board| (board, Wanted::All)).collect());
    }
    let image = |name: &String| match name.strip_prefix(SELF_TEST) {
        // There is one Nucleo.
        Some("nucleo") => Ok((find("nucleo-h743")?, Wanted::SelfTest)),
        Some(board) => Ok((find(board)?, Wanted::SelfTest)),
        None => Ok((find(name)?, Wanted::All)),
    };
    names.iter().map(image).collect()
}

/// The boards of these names; all if none is named.
pub fn select(names: &[String]) -> Result<Vec<&'static Board>> {
    if names.is_empty() {
        return Ok(BOARDS.iter().collect());
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

    /// A wrong name is answered with the right ones; no name means all.
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
        assert_eq!(
            all,
            [
                "mps2-an500",
                "pico",
                "pico-boot",
                "pico-a",
                "pico-b",
                "pico2",
                "pico2-ab",
                "nucleo-h743",
                "nucleo-h743-boot",
                "nucleo-h743-a",
                "nucleo-h743-b"
            ]
        );
        assert_eq!(select(&["pico".into()]).unwrap()[0].package, "umi-pico");
    }

    /// A self-test goes by its board's name, or by the short one.
    #[test]
    fn names_of_self_tests() {
        let names = [
            "selftest-pico",
            "selftest-nucleo",
            "selftest-nucleo-h743",
            "pico",
        ];
        let images = select_images(&names.map(String::from)).unwrap();
        let told: Vec<_> = images
            .iter()
            .map(|(board, wanted)| (board.name, *wanted))
            .collect();
        assert_eq!(
            told,
            [
                ("pico", Wanted::SelfTest),
                ("nucleo-h743", Wanted::SelfTest),
                ("nucleo-h743", Wanted::SelfTest),
                ("pico", Wanted::All),
            ]
        );
        assert!(select_images(&["selftest-pico3".into()]).is_err());
        assert_eq!(select_images(&[]).unwrap().len(), 11);
    }
}
