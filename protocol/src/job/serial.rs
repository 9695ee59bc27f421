//! Settings of the serial line to the control: the `line` part of a job.
//!
//! ```toml
//! [line]
//! control = "fanuc"   # 19200 baud, 7 data bits and parity, 2 stop bits
//! baud = 9600         # but this control is set to 9600
//! ```
//!
//! Without it the line has 115200 baud, 8 bits, 1 stop bit, and follows CTS where the board has
//! the wire.
//!
//! # Data bits and parity
//!
//! The board's port always moves 8 bits between start and stop. A frame of 7 data bits and a
//! parity bit is as long: its eighth bit is checked and made in software
//! ([`crate::job::pattern::Coding`]). So 8 data bits with a ninth for parity, and 7 without, are
//! refused by name.
//!
//! # Sources
//!
//! Fanuc: 2 stop bits, connection manuals B-63503EN (0i-A) and Power Mate; parameter 0103 ends at
//! 12, 19200 baud. Haas: setting 11 goes to 115200. The defaults of the others are those of this
//! project's macros and not from a manual.

use postcard_derive::Schema;
use serde::{Deserialize, Serialize};

/// The slowest line, baud.
pub const LEAST_BAUD: u32 = 300;
/// The fastest line, baud.
pub const MOST_BAUD: u32 = 230_400;

/// Rates that controls have, the usual ones: where to look for one that is not known.
pub const USUAL_BAUD: [u32; 11] = [
    9600, 19_200, 4800, 115_200, 38_400, 57_600, 2400, 1200, 230_400, 600, 300,
];

/// A UART that is opened in the midst of a text without a pause hears it right within so many characters.
pub const ALIGNING_CHARACTERS: u64 = 80;

/// The line to the control, as a job gives it: what is absent is as the control's family has it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(deny_unknown_fields, default)]
pub struct LineSpec {
    /// Whose defaults.
    pub control: LineFamily,
    /// Bits per second, [`LEAST_BAUD`] to [`MOST_BAUD`].
    pub baud: Option<u32>,
    /// 7 (and a parity bit) or 8 (and none).
    pub data_bits: Option<u8>,
    /// 1 or 2, of what the board sends. It takes either.
    pub stop_bits: Option<u8>,
    /// Whether the board sends only while the control's CTS lets it. Without the wire: `false`.
    pub rts_cts: Option<bool>,
}

/// Controls that set their lines alike.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(rename_all = "snake_case")]
pub enum LineFamily {
    /// Nothing is known of it: 115200 baud, 8 bits, 1 stop bit; CTS is followed where the board
    /// has the wire.
    #[default]
    Any,
    /// 19200 baud, 7 bits and parity, 2 stop bits, no CTS.
    Fanuc,
    /// 115200 baud, 8 bits, 1 stop bit, no CTS.
    Haas,
    /// 9600 baud, 7 bits and parity, 2 stop bits, no CTS.
    Mitsubishi,
    /// 9600 baud, 7 bits and parity, 2 stop bits, no CTS.
    Mazak,
    /// 9600 baud, 8 bits, 1 stop bit, no CTS.
    LinuxCnc,
    /// 115200 baud, 8 bits, 1 stop bit, no CTS.
    Grbl,
}

impl LineFamily {
    /// All of them.
    pub const ALL: [Self; 7] = [
        Self::Any,
        Self::Fanuc,
        Self::Haas,
        Self::Mitsubishi,
        Self::Mazak,
        Self::LinuxCnc,
        Self::Grbl,
    ];

    /// The name used in files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Any => "any",
            Self::Fanuc => "fanuc",
            Self::Haas => "haas",
            Self::Mitsubishi => "mitsubishi",
            Self::Mazak => "mazak",
            Self::LinuxCnc => "linux_cnc",
            Self::Grbl => "grbl",
        }
    }

    /// How its line is set where a job says nothing else.
    #[must_use]
    pub const fn defaults(self) -> LineSettings {
        let (baud, data_bits, stop_bits) = match self {
            Self::Any | Self::Haas | Self::Grbl => (115_200, 8, 1),
            Self::Fanuc => (19_200, 7, 2),
            Self::Mitsubishi | Self::Mazak => (9600, 7, 2),
            Self::LinuxCnc => (9600, 8, 1),
        };
        let cts = match self {
            Self::Any => Cts::AsWired,
            _ => Cts::Ignored,
        };
        LineSettings {
            baud,
            data_bits,
            stop_bits,
            cts,
        }
    }
}

/// Whether the control's CTS holds the board.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
#[serde(rename_all = "snake_case")]
pub enum Cts {
    /// Where the board has the wire.
    AsWired,
    /// No: the wire may hang open.
    Ignored,
    /// Yes: a board without the wire refuses.
    Followed,
}

/// A line's settings, every one of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[postcard(crate = crate)]
pub struct LineSettings {
    /// Bits per second.
    pub baud: u32,
    /// 7 and a parity bit, or 8: the port itself does not differ.
    pub data_bits: u8,
    /// Stop bits of what the board sends: 1 or 2.
    pub stop_bits: u8,
    /// Whether the control's CTS holds the board.
    pub cts: Cts,
}

impl LineSettings {
    /// As a line is where nothing has been said of it.
    pub const DEFAULT: Self = LineFamily::Any.defaults();

    /// Bits of a character that the board sends: start, eight, stop.
    #[must_use]
    pub const fn bits(&self) -> u32 {
        9 + self.stop_bits as u32
    }

    /// How long a character of eleven bits takes, the longest, microseconds, rounded up.
    #[must_use]
    pub const fn character_us(&self) -> u64 {
        let baud = if self.baud == 0 { 1 } else { self.baud };
        (11_000_000_u64).div_ceil(baud as u64)
    }

    /// As they stand on a screen: `19200 7P2`. P is any parity, N none.
    #[must_use]
    pub const fn frame(&self) -> &'static str {
        match (self.data_bits, self.stop_bits) {
            (7, 2) => "7P2",
            (7, _) => "7P1",
            (_, 2) => "8N2",
            _ => "8N1",
        }
    }
}

impl Default for LineSettings {
    fn default() -> Self {
        Self::DEFAULT
    }
}

impl LineSpec {
    /// The line with everything that the job leaves to the control's family.
    #[must_use]
    pub const fn settings(&self) -> LineSettings {
        let mut line = self.control.defaults();
        if let Some(baud) = self.baud {
            line.baud = baud;
        }
        if let Some(data_bits) = self.data_bits {
            line.data_bits = data_bits;
        }
        if let Some(stop_bits) = self.stop_bits {
            line.stop_bits = stop_bits;
        }
        if let Some(rts_cts) = self.rts_cts {
            line.cts = if rts_cts { Cts::Followed } else { Cts::Ignored };
        }
        line
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What a job says holds, the rest is the family's; nothing said is the line as it always was.
    #[test]
    fn a_job_overrides_its_family() {
        let line = LineSpec::default().settings();
        assert_eq!(line, LineSettings::DEFAULT);
        assert_eq!((line.baud, line.frame()), (115_200, "8N1"));
        let spec = LineSpec {
            control: LineFamily::Fanuc,
            baud: Some(4800),
            rts_cts: Some(true),
            ..LineSpec::default()
        };
        let line = spec.settings();
        assert_eq!(
            (line.baud, line.frame(), line.cts),
            (4800, "7P2", Cts::Followed)
        );
        // 11 bits at 4800 baud: 2291.7 us.
        assert_eq!((line.bits(), line.character_us()), (11, 2292));
    }

    /// Every family's line can be had, and Fanuc's ends where its parameter does.
    #[test]
    fn the_families_are_in_range() {
        for family in LineFamily::ALL {
            let line = family.defaults();
            assert!((LEAST_BAUD..=MOST_BAUD).contains(&line.baud), "{family:?}");
            assert!(USUAL_BAUD.contains(&line.baud), "{family:?}");
        }
        assert_eq!(LineFamily::Fanuc.defaults().stop_bits, 2);
        assert!(LineFamily::Fanuc.defaults().baud <= 19_200);
    }
}
