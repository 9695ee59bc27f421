//! Jobs as they were written up to protocol 2.24, with one probing sigma for the three axes.
//!
//! They stand in the settings of boards and in journals. All else of them is as today, so the two
//! sigmas that are missing are put in, and what comes out is read as a job of today. Where
//! another part of a job changes its layout, the types of before go with it into [`Head`].

use heapless::Vec;

use super::pattern::ReceiverConfig;
use super::{
    Closing, Compensation, CorrectionSpec, FeatureSpec, LearnedLimits, Limits, MAX_CLOSING,
    MAX_FEATURES, MAX_FIXED, Name, Reference, Teach, WitnessSpec,
};

/// So many bytes a job is longer than it was, at most.
pub const GROWN: usize = 16;

/// A job up to its sigma.
type Head = (
    Name,
    Reference,
    u32,
    ReceiverConfig,
    Vec<FeatureSpec, MAX_FEATURES, u8>,
    Compensation,
    Limits,
    Option<CorrectionSpec>,
    Option<WitnessSpec>,
    Teach,
    GuardsHead,
);

type GuardsHead = (
    Vec<Closing, MAX_CLOSING, u8>,
    Vec<Name, MAX_FIXED, u8>,
    Option<f64>,
    Option<f64>,
    Option<LearnedLimits>,
    Option<[u8; SIGMA]>,
);

/// Bytes of a number.
const SIGMA: usize = 8;

/// Makes a job of before one of today. It begins `bytes` and has `len` of them together with what
/// stands behind it; there is room for [`GROWN`] more. How many it has then; none if it is no job.
pub fn widen(bytes: &mut [u8], len: usize) -> Option<usize> {
    let Some(end) = sigma_end(bytes.get(..len)?)? else {
        return Some(len);
    };
    let sigma = end.checked_sub(SIGMA)?..end;
    let grown = len
        .checked_add(GROWN)
        .filter(|grown| *grown <= bytes.len())?;
    bytes.copy_within(end..len, end + GROWN);
    for times in 1..=GROWN / SIGMA {
        bytes.copy_within(sigma.clone(), sigma.start + times * SIGMA);
    }
    Some(grown)
}

/// Where its sigma ends, if it has one; none if it is no job.
///
/// Not inlined: it has room for a whole job on its stack.
#[inline(never)]
fn sigma_end(job: &[u8]) -> Option<Option<usize>> {
    let (head, rest) = postcard::take_from_bytes::<Head>(job).ok()?;
    let (.., (.., sigma)) = head;
    Some(sigma.map(|_| job.len() - rest.len()))
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::vec::Vec as List;

    use super::*;
    use crate::job::{Guards, Job, ProbingSpec};

    fn job(probing: Option<ProbingSpec>) -> Job {
        Job {
            name: crate::job::name("BEFORE"),
            reference: Reference::Taught,
            plate_timeout_s: 1800,
            receiver: ReceiverConfig::default(),
            features: Vec::new(),
            compensation: Compensation::InMacro,
            limits: Limits {
                radius_error_mm: 0.03,
                rms_mm: 0.015,
                approach_deg: None,
                lone_hit_mm: None,
                distance_error_mm: 0.01,
                registration_rms_mm: 0.005,
                rotation_deg: 3.0,
                tilt_deg: 0.01,
                shift_mm: [60.0; 3],
                expected_error_mm: None,
            },
            correction: None,
            witness: None,
            teach: Teach::Asked,
            guards: Guards {
                fixed_mm: Some(0.004),
                probing,
                run_variable: Some(531),
                ..Guards::default()
            },
            line: Default::default(),
            skip: Default::default(),
            again: None,
        }
    }

    fn written(job: &Job) -> List<u8> {
        let mut bytes = [0; 2048];
        postcard::to_slice(job, &mut bytes).unwrap().to_vec()
    }

    /// One sigma becomes three, whatever stands behind; a job without one stays as it is.
    #[test]
    fn one_sigma_becomes_three() {
        let today = written(&job(Some(ProbingSpec::alike(0.0012, 19))));
        let sigma = 0.0012_f64.to_le_bytes();
        let at = today.windows(8).position(|at| at == sigma).unwrap();
        for behind in [&[][..], &[1, 2, 3]] {
            let mut bytes = [&today[..at + 8], &today[at + 24..], behind].concat();
            let len = bytes.len();
            assert_eq!(widen(&mut bytes, len), None, "no room");
            bytes.resize(len + GROWN, 0xFF);
            assert_eq!(widen(&mut bytes, len), Some(len + GROWN));
            assert_eq!(bytes, [&today, behind].concat());
        }
        let mut without = written(&job(None));
        let (len, before) = (without.len(), without.clone());
        assert_eq!(widen(&mut without, len), Some(len));
        assert_eq!(without, before);
    }

    /// What ends too early is no job, and nothing is read behind its end.
    #[test]
    fn what_is_no_job_stays_none() {
        let mut bytes = written(&job(None));
        for len in 0..40 {
            assert_eq!(widen(&mut bytes, len), None);
        }
        let more = bytes.len() + 1;
        assert_eq!(widen(&mut bytes, more), None);
    }
}
