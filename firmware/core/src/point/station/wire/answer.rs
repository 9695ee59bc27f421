//! What the control reads: a program that sets four variables.

use core::fmt::Write as _;

use heapless::String;

use super::command::check_value;
use crate::point::station::record::PlaceState;
use crate::units::Mm;

/// The program that the macro calls with `M198`.
pub const ANSWER_PROGRAM: u32 = 8849;

/// Longest answer.
pub const ANSWER_BYTES: usize = 96;

/// An answer to a command.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CommandAnswer {
    /// Mean reading; 0 where there is none.
    pub gamma: Mm,
    /// How it ended.
    pub state: PlaceState,
    /// The command's own number.
    pub sequence: u16,
}

impl CommandAnswer {
    /// The program: `#501` distance with four decimals, `#502` state, `#503` the command's
    /// number, `#504` the check value of the three.
    #[must_use]
    pub fn program(&self) -> String<ANSWER_BYTES> {
        let tenths_um = libm::round(self.gamma.0 * 1e4).clamp(0.0, 99_999_999.0) as i64;
        let state = i64::from(self.state.number());
        let sequence = i64::from(self.sequence);
        let check = check_value(&[tenths_um, state * 1000, sequence * 1000]);
        let mut text = String::new();
        // The longest one has 77 characters.
        let _ = write!(
            text,
            "%\nO{ANSWER_PROGRAM}\n#501={}.{:04}\n#502={state}.\n#503={sequence}.\n#504={check}.\nM99\n%\n",
            tenths_um / 10_000,
            tenths_um % 10_000
        );
        text
    }
}
