//! Flow control of the receiving direction: which code the control is due.
//!
//! A control is told only if its job says that it obeys ([`Handshake::XonXoff`]): for the
//! others the codes would be text. XON is due when such a job is taken up, too: the board
//! may have been reset after its XOFF.
//!
//! # Limitations
//!
//! XON is sent once: a control to which it does not come stays held until its operator
//! resets it. After a reset of the board the parity may be unknown; XON is then sent
//! without it.

use umi_protocol::pattern::{Coding, Handshake};

use super::codes::{PARITY, XOFF, XON};

/// What the control has been told.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Throttle {
    /// Nothing.
    #[default]
    Untold,
    /// It may send.
    Open,
    /// It may not.
    Closed,
}

/// Decides which code the control is due.
#[derive(Clone, Debug)]
pub struct RxFlowControl {
    handshake: Handshake,
    told: Throttle,
    /// What parity adds to the codes.
    in_xon: u8,
    in_xoff: u8,
}

impl RxFlowControl {
    /// For a control of which nothing is known. All zeros.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            handshake: Handshake::None,
            told: Throttle::Untold,
            in_xon: 0,
            in_xoff: 0,
        }
    }

    /// Notes what the job says of the control. Returns whether that is something new.
    pub fn note_handshake(&mut self, handshake: Handshake) -> bool {
        let is_new = self.handshake != handshake;
        self.handshake = handshake;
        is_new
    }

    /// Notes the code in which the control writes. In EIA both codes are as in ISO.
    pub fn note_coding(&mut self, coding: Coding) {
        (self.in_xon, self.in_xoff) = match coding {
            Coding::Auto | Coding::Ascii => (0, 0),
            Coding::IsoEven | Coding::Eia => (0, PARITY),
            Coding::AsciiOdd => (PARITY, 0),
        };
    }

    /// What the control should have been told, and the code that is due for it.
    #[must_use]
    pub fn due(&self, is_pressed: bool) -> (Throttle, Option<u8>) {
        let want = match self.handshake {
            Handshake::None => Throttle::Untold,
            Handshake::XonXoff if is_pressed => Throttle::Closed,
            Handshake::XonXoff => Throttle::Open,
        };
        let code = match (self.told, want) {
            (Throttle::Untold | Throttle::Open, Throttle::Closed) => Some(XOFF | self.in_xoff),
            (Throttle::Untold | Throttle::Closed, Throttle::Open)
            | (Throttle::Closed, Throttle::Untold) => Some(XON | self.in_xon),
            _ => None,
        };
        (want, code)
    }

    /// What was due has left for the line.
    pub fn told(&mut self, throttle: Throttle) {
        self.told = throttle;
    }
}

impl Default for RxFlowControl {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The code that is due, when it leaves at once.
    fn tell(flow: &mut RxFlowControl, is_pressed: bool) -> Option<u8> {
        let (want, code) = flow.due(is_pressed);
        flow.told(want);
        code
    }

    /// The codes carry the parity of the control's own characters.
    #[test]
    fn parity() {
        let codings = [
            Coding::Ascii,
            Coding::IsoEven,
            Coding::AsciiOdd,
            Coding::Eia,
        ];
        let told = codings.map(|coding| {
            let mut flow = RxFlowControl::new();
            flow.note_handshake(Handshake::XonXoff);
            flow.note_coding(coding);
            [false, true, false].map(|is_pressed| tell(&mut flow, is_pressed).unwrap())
        });
        let even = [0x11, 0x93, 0x11];
        assert_eq!(told, [[0x11, 0x13, 0x11], even, [0x91, 0x13, 0x91], even]);
    }

    /// A job for another control lets go the one that is held.
    #[test]
    fn another_job_lets_go() {
        let mut flow = RxFlowControl::new();
        assert!(flow.note_handshake(Handshake::XonXoff));
        assert_eq!(tell(&mut flow, true), Some(XOFF));
        assert_eq!(tell(&mut flow, true), None);
        assert!(flow.note_handshake(Handshake::None));
        assert_eq!(tell(&mut flow, true), Some(XON));
        assert_eq!(tell(&mut flow, true), None);
    }
}
