//! The machine's wires: each signal with its true time.

use umi_core::units::Micros;

/// The receiving end: a board, a log, or nobody ([`Unwired`]).
///
/// Calls come in the order of their times, which never go back.
pub trait Wires {
    /// Bytes on the control's serial line; `at` is when the last of them has gone.
    fn serial(&mut self, at: Micros, bytes: &[u8]);

    /// The probe's skip line rises. `counts` are the encoders' counts of X, Y and Z
    /// at that instant.
    fn skip(&mut self, at: Micros, counts: [i64; 3]);

    /// Nothing else happens until then: time passes.
    fn time(&mut self, now: Micros);

    /// How often [`Self::moved`] is told of axes in motion, seconds; none: never.
    fn sampling_s(&self) -> Option<f64> {
        None
    }

    /// The encoders' counts of X, Y and Z at that instant: when the machine is switched
    /// on, along a motion and at its end.
    fn moved(&mut self, _at: Micros, _counts: [i64; 3]) {}
}

/// Nothing is connected.
#[derive(Clone, Copy, Debug, Default)]
pub struct Unwired;

impl Wires for Unwired {
    fn serial(&mut self, _: Micros, _: &[u8]) {}
    fn skip(&mut self, _: Micros, _: [i64; 3]) {}
    fn time(&mut self, _: Micros) {}
}
