//! Budgets of the images, and what happens above them.

use anyhow::{Result, bail};
use imagecheck::image::ImageFigures;
use serde::Deserialize;

use crate::tasks::firmware::toolchain::Compiler;

/// What an image may take at most.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Budget {
    /// Code, constants, initial values.
    pub flash_bytes: u64,
    /// Variables.
    pub static_bytes: u64,
    /// The worst stack.
    pub stack_bytes: u64,
    /// Calls of the core library's panics.
    pub panic_calls: u64,
    /// Of them, those that an interrupt can reach, not counting the tasks that it runs.
    pub interrupt_panic_calls: u64,
}

impl Budget {
    /// What of the budget the image does not keep.
    pub fn broken_by(&self, figures: &ImageFigures) -> impl Iterator<Item = String> {
        let held = [
            ("bytes of flash", figures.flash_bytes, self.flash_bytes),
            (
                "bytes of static RAM",
                figures.static_bytes,
                self.static_bytes,
            ),
            (
                "bytes of stack (--stack shows the calls)",
                figures.stack_bytes(),
                self.stack_bytes,
            ),
            (
                "calls of panics (--panics lists them)",
                figures.panic_calls().into(),
                self.panic_calls,
            ),
            (
                "calls of panics in interrupts (--panics lists them)",
                figures.interrupt_panic_calls().into(),
                self.interrupt_panic_calls,
            ),
        ];
        held.into_iter()
            .filter(|(_, figure, budget)| figure > budget)
            .map(|(what, figure, budget)| format!("{figure} {what}, budget {budget}"))
    }
}

/// What makes an image wrong whatever its budget says: its stack is not bounded, or does not
/// fit beside its variables; or an interrupt can log, and so wait for a debug probe.
pub fn unsound(figures: &ImageFigures) -> impl Iterator<Item = String> {
    let stack = figures.stack_bytes();
    let no_room = stack > figures.room_bytes;
    let no_room = no_room.then(|| {
        format!(
            "{stack} bytes of stack, where {} are left beside the variables",
            figures.room_bytes
        )
    });
    no_room
        .into_iter()
        .chain(figures.unbounded.iter().map(|name| {
            format!("the stack of `{name}` is not known: it moves the stack pointer by a register")
        }))
        .chain(figures.logging.iter().map(|(handler, log)| {
            format!("the interrupt `{handler}` can log, by `{log}`: log from a task")
        }))
}

/// Holds what the images break: a budget is a promise about the pinned compiler, with another
/// it is only returned, to be shown; an unsound image is an error with each.
pub fn hold(compiler: &Compiler, over: Vec<String>, unsound: &[String]) -> Result<Vec<String>> {
    if !unsound.is_empty() {
        bail!("images that cannot run safely:\n  {}", unsound.join("\n  "));
    }
    if compiler.is_pinned && !over.is_empty() {
        bail!(
            "over budget; go below it, or raise it in the board's Cargo.toml and say why:\n  {}",
            over.join("\n  ")
        );
    }
    Ok(over)
}

#[cfg(test)]
mod tests {
    use imagecheck::reach::{EntryKind, EntryPanics};
    use imagecheck::stack::StackNeed;

    use super::*;

    fn figures() -> ImageFigures {
        ImageFigures {
            flash_bytes: 1000,
            static_bytes: 200,
            stack: vec![StackNeed {
                bytes: 300,
                chain: Vec::new(),
            }],
            room_bytes: 400,
            panics: [("umi_core::x".to_owned(), 7)].into(),
            reachable: vec![
                reaches(EntryKind::Interrupt, 2),
                reaches(EntryKind::Task, 9),
            ],
            ..ImageFigures::default()
        }
    }

    fn reaches(kind: EntryKind, calls: u32) -> EntryPanics {
        EntryPanics {
            kind,
            name: "TIMER_IRQ".to_owned(),
            calls: [("umi_core::x".to_owned(), calls)].into(),
        }
    }

    fn budget() -> Budget {
        Budget {
            flash_bytes: 1000,
            static_bytes: 200,
            stack_bytes: 300,
            panic_calls: 7,
            interrupt_panic_calls: 2,
        }
    }

    fn compiler(is_pinned: bool) -> Compiler {
        Compiler {
            version: "rustc 1.96.0".into(),
            origin: "a test's",
            is_pinned,
            pinned: "1.95.0".into(),
        }
    }

    /// An image on its budget keeps it; one more of anything breaks it, by name.
    #[test]
    fn each_figure_is_held() {
        assert_eq!(budget().broken_by(&figures()).count(), 0);
        let figures = ImageFigures {
            flash_bytes: 1001,
            static_bytes: 201,
            stack: vec![StackNeed {
                bytes: 301,
                chain: Vec::new(),
            }],
            panics: [("umi_core::x".to_owned(), 8)].into(),
            reachable: vec![reaches(EntryKind::Interrupt, 3)],
            ..figures()
        };
        let broken: Vec<String> = budget().broken_by(&figures).collect();
        let words = ["flash", "static", "stack", "of panics", "in interrupts"];
        assert_eq!(broken.len(), words.len(), "{broken:?}");
        for (line, what) in broken.iter().zip(words) {
            assert!(line.contains(what), "{line}");
        }
    }

    /// Over budget is an error with the pinned compiler, and no more than said with another.
    #[test]
    fn budgets_are_about_the_pinned_compiler() {
        let over = || vec!["pico: 1001 bytes of flash, budget 1000".to_owned()];
        let error = hold(&compiler(true), over(), &[]).unwrap_err().to_string();
        assert!(
            error.contains("over budget") && error.contains("pico: 1001"),
            "{error}"
        );
        assert_eq!(hold(&compiler(false), over(), &[]).unwrap(), over());
        assert!(hold(&compiler(true), Vec::new(), &[]).unwrap().is_empty());
    }

    /// A stack that does not fit, or is not known, or an interrupt that logs is an error with every
    /// compiler.
    #[test]
    fn unsound_images() {
        let tight = ImageFigures {
            room_bytes: 299,
            ..figures()
        };
        let unknown = ImageFigures {
            unbounded: vec!["memmove".into()],
            ..figures()
        };
        let logging = ImageFigures {
            logging: [("UART_IRQ".into(), "_defmt_acquire".into())].into(),
            ..figures()
        };
        assert_eq!(unsound(&figures()).count(), 0);
        for (figures, word) in [
            (tight, "299"),
            (unknown, "memmove"),
            (logging, "`UART_IRQ` can log, by `_defmt_acquire`"),
        ] {
            let what: Vec<String> = unsound(&figures).collect();
            for is_pinned in [true, false] {
                let error = hold(&compiler(is_pinned), Vec::new(), &what).unwrap_err();
                assert!(error.to_string().contains(word), "{error}");
            }
        }
    }
}
