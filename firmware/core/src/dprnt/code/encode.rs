//! Encoding of text to the control, in the control's own character code.

use umi_protocol::pattern::Coding;

use super::code_table::{LF, eia_of};

/// EIA's end of block, its line end.
const EIA_EOB: u8 = 0x80;

/// The byte for an ASCII character; none if the code does not have it. A code
/// that is not known yet is taken as plain ASCII.
#[must_use]
pub fn encode(coding: Coding, ascii: u8) -> Option<u8> {
    let even = ascii.count_ones().is_multiple_of(2);
    match coding {
        _ if !ascii.is_ascii() => None,
        Coding::Auto | Coding::Ascii => Some(ascii),
        Coding::IsoEven => Some(if even { ascii } else { ascii | 0x80 }),
        Coding::AsciiOdd => Some(if even { ascii | 0x80 } else { ascii }),
        Coding::Eia if ascii == LF => Some(EIA_EOB),
        Coding::Eia => eia_of(ascii),
    }
}

#[cfg(test)]
mod tests {
    use std::vec::Vec;

    use super::*;

    /// Spot values of the capture of the Brother manual (ISO) and of RS-244.
    #[test]
    fn known_bytes() {
        let iso: Vec<_> = b"X -1.\n"
            .iter()
            .map(|b| encode(Coding::IsoEven, *b))
            .collect();
        assert_eq!(iso, [0xD8, 0xA0, 0x2D, 0xB1, 0x2E, 0x0A].map(Some));
        let eia: Vec<_> = b"G10X-.%\n"
            .iter()
            .map(|b| encode(Coding::Eia, *b))
            .collect();
        assert_eq!(
            eia,
            [0x67, 0x01, 0x20, 0x37, 0x40, 0x6B, 0x0B, 0x80].map(Some)
        );
        assert_eq!(encode(Coding::Eia, b'#'), None);
        assert_eq!(encode(Coding::IsoEven, 0x80), None);
    }

    /// Every character of a correction program exists in every code.
    #[test]
    fn correction_programs_can_be_sent_in_every_code() {
        let all = b"%O0123456789()ABCDEFGHIJKLMNOPQRSTUVWXYZ -.\n";
        for coding in [
            Coding::Ascii,
            Coding::IsoEven,
            Coding::AsciiOdd,
            Coding::Eia,
        ] {
            for byte in all {
                assert!(encode(coding, *byte).is_some(), "{coding} {byte}");
            }
        }
    }
}
