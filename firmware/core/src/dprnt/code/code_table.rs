//! The character codes as tables, computed when the program is built.
#![allow(clippy::indexing_slicing)] // an index out of range does not compile

use umi_protocol::pattern::Coding;

/// The codes in the order in which they are numbered here.
pub(in crate::dprnt) const CODES: [Coding; 4] = [
    Coding::Ascii,
    Coding::IsoEven,
    Coding::AsciiOdd,
    Coding::Eia,
];
pub(in crate::dprnt) const ASCII: u8 = 0;
const ISO_EVEN: u8 = 1;
const ASCII_ODD: u8 = 2;
const EIA: u8 = 3;

/// The weight of a line end that a code does not have.
const FOREIGN_LINE_END: u8 = 4;

pub(in crate::dprnt) const LF: u8 = 0x0A;
pub(in crate::dprnt) const CR: u8 = 0x0D;
pub(in crate::dprnt) const XON: u8 = 0x11;
pub(in crate::dprnt) const PUNCH_ON: u8 = 0x12;
pub(in crate::dprnt) const XOFF: u8 = 0x13;
/// XOFF with even parity, as Fanuc punches it.
pub(in crate::dprnt) const XOFF_EVEN: u8 = 0x93;
pub(in crate::dprnt) const PUNCH_OFF: u8 = 0x14;
/// DC2 and DC4 with odd parity.
pub(in crate::dprnt) const PUNCH_ON_ODD: u8 = 0x92;
pub(in crate::dprnt) const PUNCH_OFF_ODD: u8 = 0x94;
pub(in crate::dprnt) const ETX: u8 = 0x03;
const EOT: u8 = 0x04;
pub(in crate::dprnt) const NAK: u8 = 0x15;
pub(in crate::dprnt) const SYN: u8 = 0x16;
const EIA_EOB: u8 = 0x80;

/// What a byte stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::dprnt) enum Character {
    /// A printable character; a tab is a blank.
    Text(u8),
    /// A control code that carries nothing: XOFF, SI, SO, feed.
    Dropped,
    /// The other side ends its transmission (ETX, EOT).
    Close,
    /// A control code without the parity of the code: one wrong bit may have
    /// made it of a digit. It carries nothing, but must not stand in a line.
    Suspect,
    /// Wrong parity.
    BadParity,
    /// Not in the code, or a control code that no text line has.
    Unknown,
}

/// EIA RS-244 to ASCII; 0 where there is no character. End of record (0x0B)
/// is what controls send and take as `%`.
const EIA_TO_ASCII: [u8; 128] = {
    let mut table = [0u8; 128];
    let codes: [(u8, &[u8]); 8] = [
        (
            b'0',
            &[0x20, 0x01, 0x02, 0x13, 0x04, 0x15, 0x16, 0x07, 0x08, 0x19],
        ),
        (
            b'A',
            &[0x61, 0x62, 0x73, 0x64, 0x75, 0x76, 0x67, 0x68, 0x79],
        ),
        (
            b'J',
            &[0x51, 0x52, 0x43, 0x54, 0x45, 0x46, 0x57, 0x58, 0x49],
        ),
        (b'S', &[0x32, 0x23, 0x34, 0x25, 0x26, 0x37, 0x38, 0x29]),
        // + , - . /
        (b'+', &[0x70, 0x3B, 0x40, 0x6B, 0x31]),
        // % &
        (b'%', &[0x0B, 0x0E]),
        // ( )
        (b'(', &[0x1A, 0x4A]),
        (b' ', &[0x10]),
    ];
    let mut group = 0;
    while group < codes.len() {
        let (first, list) = codes[group];
        let mut i = 0;
        while i < list.len() {
            table[list[i] as usize] = first + i as u8;
            i += 1;
        }
        group += 1;
    }
    // Tab is a blank too.
    table[0x3E] = b' ';
    table
};

/// The EIA byte of an ASCII character; none if EIA does not have it.
pub(in crate::dprnt) fn eia_of(ascii: u8) -> Option<u8> {
    let place = EIA_TO_ASCII
        .iter()
        .position(|a| *a == ascii && ascii != 0)?;
    u8::try_from(place).ok()
}

/// What a seven bit character stands for.
const fn seven_bits(byte: u8) -> Character {
    match byte {
        0x20..=0x7E => Character::Text(byte),
        b'\t' => Character::Text(b' '),
        0x00 | 0x0E | 0x0F | 0x7F | XON..=PUNCH_OFF => Character::Dropped,
        ETX | EOT => Character::Close,
        _ => Character::Unknown,
    }
}

/// What a byte stands for in a code.
const fn decode(code: u8, byte: u8) -> Character {
    let odd = byte.count_ones() % 2 == 1;
    match code {
        ASCII => match byte {
            0x80.. => Character::Unknown,
            _ => seven_bits(byte),
        },
        ISO_EVEN if odd => Character::BadParity,
        ASCII_ODD if !odd => match byte {
            0x00 | XON => Character::Suspect,
            _ => Character::BadParity,
        },
        ISO_EVEN | ASCII_ODD => seven_bits(byte & 0x7F),
        _ => match byte {
            // The device controls keep their values, which have even parity.
            0x00 | XON | PUNCH_ON | XOFF_EVEN | PUNCH_OFF => Character::Suspect,
            0x7F => Character::Dropped,
            _ if !odd => Character::BadParity,
            0x80.. => Character::Unknown,
            _ => match EIA_TO_ASCII[byte as usize] {
                0 => Character::Unknown,
                text => Character::Text(text),
            },
        },
    }
}

/// What every byte stands for in every code.
pub(in crate::dprnt) static CHARACTERS: [[Character; 256]; 4] = {
    let mut table = [[Character::Unknown; 256]; 4];
    let mut code = 0;
    while code < 4 {
        let mut byte = 0;
        while byte < 256 {
            table[code][byte] = decode(code as u8, byte as u8);
            byte += 1;
        }
        code += 1;
    }
    table
};

/// The codes in which a byte ends a line, one bit each.
pub(in crate::dprnt) const fn ends(byte: u8) -> u8 {
    match byte {
        LF => 1 << ASCII | 1 << ISO_EVEN,
        CR => 1 << ASCII | 1 << ASCII_ODD,
        0x8D => 1 << ISO_EVEN,
        0x8A => 1 << ASCII_ODD,
        EIA_EOB => 1 << EIA,
        _ => 0,
    }
}

/// How much a byte contradicts each code.
pub(in crate::dprnt) static CONTRADICTS: [[u8; 4]; 256] = {
    let mut table = [[0u8; 4]; 256];
    let mut byte = 0;
    while byte < 256 {
        let ends = ends(byte as u8);
        let mut code = 0;
        while code < 4 {
            let ends_here = ends & 1 << code != 0;
            table[byte][code as usize] = match decode(code, byte as u8) {
                _ if ends_here => 0,
                // LF is no character of EIA, nor EOB one of the others.
                _ if byte as u8 == LF && code == EIA => FOREIGN_LINE_END,
                _ if byte as u8 == EIA_EOB && code != EIA => FOREIGN_LINE_END,
                Character::BadParity | Character::Unknown => 1,
                _ => 0,
            };
            code += 1;
        }
        byte += 1;
    }
    table
};
