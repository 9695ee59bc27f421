//! Control codes of the line.

/// DC1: go on, or send me the program.
pub const XON: u8 = 0x11;
/// DC3: stop.
pub const XOFF: u8 = 0x13;
/// Set by parity in DC codes: in XOFF by even, in XON by odd parity.
pub const PARITY: u8 = 0x80;
/// SYN: a Fanuc remote buffer says it behind XOFF when it is reset, as it says NAK when it
/// has an alarm. It will not go on. In EIA both are digits.
pub const SYN: u8 = 0x16;
