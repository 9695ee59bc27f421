//! Signed heads: when the board vouches for its journal.
//!
//! # Design
//!
//! A signature takes a while, on a chip without a multiplier for long numbers a tenth of a
//! second. So none is made while something waits for the measuring: while a clamping is under
//! way, while something goes out to the control, while a correction waits for it (but for a host
//! that asks), while the control punches, and until the inputs have been quiet for [`QUIET_US`]. Captures and characters never wait for
//! it: their tasks are of a higher priority.
//!
//! A head is due at the start and behind each verdict, when a host asks for one over its nonce,
//! and when [`MOST_ENTRIES`] entries have no head behind them. In that last case nothing but a
//! transmission is waited for: noise on the line that never ends must not keep the board from
//! signing.
//!
//! # Limitations
//!
//! An input that comes while a signature is made waits for its end, a READ too. A verdict whose
//! clamping begins and ends within that time is that much later. Behind [`MOST_ENTRIES`] entries
//! within one clamping it is signed in that clamping.

use umi_core::journal::Flash;
use umi_core::units::Micros;
use umi_protocol::head::{Head, HeadAnswer};
use umi_protocol::message::Record;
use umi_protocol::schema::max_len;

use crate::measure::Instrument;
pub use crate::measure::trust::signer::HeadSigner;

/// Without an input for so long, the control waits for nothing.
pub const QUIET_US: u64 = 300_000;

/// A host that asks waits so long for a line that is never quiet.
pub const ASKED_US: u64 = 1_000_000;

/// Bytes of a head's record, at most.
const MAX_HEAD: usize = max_len::<Head>() + 1;

/// Entries of the journal that may stand without a head behind them.
pub const MOST_ENTRIES: u64 = 4096;

impl<F: Flash> Instrument<F> {
    /// The answer to a host that asks for a head. What was signed stands in the journal, and not
    /// in memory besides.
    #[inline(never)]
    pub(crate) fn head_answer(
        &mut self,
        now: Micros,
        nonce: Option<[u8; 32]>,
        is_known: bool,
    ) -> HeadAnswer {
        let ledger = &mut self.ledger;
        if !ledger.heads.signer.is_some() {
            return HeadAnswer::NoKey;
        }
        let newest = ledger.heads.has_signed.then_some(ledger.heads.since);
        let found = newest
            .zip(ledger.journal.get_mut())
            .and_then(|(seq, journal)| {
                let found = journal.read(seq, &mut ledger.scratch).ok()?;
                // Its kind stands before it. A board that could read every record would be
                // 40 KB larger.
                let (_, head) = found.payload.split_first()?;
                postcard::from_bytes::<Head>(head).ok()
            });
        match found.filter(|head| nonce.is_none() || head.nonce == nonce) {
            Some(head) => HeadAnswer::Signed(head),
            None => {
                if let Some(nonce) = nonce {
                    ledger.heads.ask(nonce, now, is_known);
                }
                HeadAnswer::Pending
            }
        }
    }

    /// When a head is to be signed, if nothing happens before; none: not as things stand.
    #[must_use]
    pub fn head_deadline(&self) -> Option<Micros> {
        let heads = &self.ledger.heads;
        let journal = self.ledger.journal.get()?;
        if !heads.signer.is_some() || self.delivery.is_some() || heads.is_full {
            return None;
        }
        if journal.next_seq().saturating_sub(heads.since) >= MOST_ENTRIES {
            return Some(heads.latest);
        }
        let asked = heads.asked.get().map(|(_, since)| *since);
        let is_asked = asked.is_some();
        let may_be_read = self.waiting().is_some() && !is_asked;
        let waits = self.brain().run().is_under_way()
            || may_be_read
            || self.ledger.upload.waits()
            || self.ledger.upload.is_busy();
        let quiet = heads.latest.0.saturating_add(QUIET_US);
        let due = match asked {
            // A line that is never quiet must not keep a host waiting.
            Some(since) => Some(quiet.min(since.0.saturating_add(ASKED_US))),
            None => heads.is_due.then_some(quiet),
        };
        due.filter(|_| !waits).map(Micros)
    }

    /// Signs a head if one is to be signed now.
    pub fn sign_head(&mut self, now: Micros) {
        if cfg!(feature = "owner") && self.head_deadline().is_some_and(|due| now >= due) {
            self.make_head(now);
        }
    }

    #[inline(never)]
    fn make_head(&mut self, now: Micros) {
        let ledger = &mut self.ledger;
        let nonce = ledger.heads.asked.take().map(|(nonce, _)| nonce);
        ledger.heads.is_due = false;
        let (Some(signer), Some(journal)) =
            (ledger.heads.signer.get().copied(), ledger.journal.get_mut())
        else {
            return;
        };
        // One that a host with a key asks for may take the last room.
        if !journal.takes(MAX_HEAD, nonce.is_some() && ledger.heads.is_known) {
            ledger.heads.is_full = true;
            return;
        }
        // Without what it says of the evidence, somebody could take that out: where the flash says nothing, the board signs
        // nothing either, until a host asks again or there is room.
        let Ok(evidence) = journal.mark() else {
            ledger.heads.is_full = true;
            return;
        };
        let mut head = Head {
            seq: journal.next_seq(),
            t_us: now.0,
            first_seq: journal.first_seq(),
            chain: journal.chain_head().0,
            boot: signer.boot(),
            key: signer.key(),
            image: signer.image(),
            serial: ledger.identity.serial.clone(),
            firmware: ledger.identity.firmware.clone(),
            nonce,
            signature: [[0; 32]; 2],
            evidence,
        };
        head.signature = signer.sign(&head.signed());
        let seq = head.seq;
        if ledger.record(now, Record::Head(head)) {
            ledger.heads.since = seq;
            ledger.heads.has_signed = true;
        }
    }
}
