//! Jobs as they were written up to protocol 2.24, with one probing sigma for the three axes.
//!
//! They stand in the settings of boards and in journals. All else of them is as today, so the two
//! sigmas that are missing are put in, and what comes out is read as a job of today. Where
//! another part of a job changes its layout, the types of before go with it into `sigma_end`.

use heapless::Vec;
use postcard::Deserializer;
use postcard::de_flavors::Slice;
use serde::Deserialize;

use super::pattern::ReceiverConfig;
use super::{
    Closing, Compensation, CorrectionSpec, FeatureSpec, LearnedLimits, Limits, MAX_CLOSING,
    MAX_FEATURES, MAX_FIXED, Name, Reference, Teach, WitnessSpec,
};

/// So many bytes a job is longer than it was, at most.
pub const GROWN: usize = 2 * SIGMA;

/// Bytes of a number.
const SIGMA: usize = 8;

/// Makes a job of before one of today. It begins `bytes` and has `len` of them together with what
/// stands behind it; there is room for [`GROWN`] more. How many it has then; none if it is no job.
pub fn widen(bytes: &mut [u8], len: usize) -> Option<usize> {
    let Some(end) = sigma_end(bytes.get(..len)?)? else {
        return Some(len);
    };
    let grown = len.checked_add(GROWN)?;
    let behind = bytes.get_mut(end.checked_sub(SIGMA)?..grown)?;
    let (sigma, behind) = behind.split_first_chunk_mut::<SIGMA>()?;
    // From the end on, so that nothing is overwritten that is still to be moved.
    for to in (GROWN..behind.len()).rev() {
        let byte = behind.get(to - GROWN).copied()?;
        *behind.get_mut(to)? = byte;
    }
    let (second, behind) = behind.split_first_chunk_mut::<SIGMA>()?;
    let (third, _) = behind.split_first_chunk_mut::<SIGMA>()?;
    (*second, *third) = (*sigma, *sigma);
    Some(grown)
}

/// Where its sigma ends, if it has one; none if it is no job.
#[inline(never)]
fn sigma_end(job: &[u8]) -> Option<Option<usize>> {
    let mut bytes = Bytes::from_bytes(job);
    take::<Name>(&mut bytes)?;
    take::<Reference>(&mut bytes)?;
    take::<u32>(&mut bytes)?;
    take::<ReceiverConfig>(&mut bytes)?;
    take::<Vec<FeatureSpec, MAX_FEATURES, u8>>(&mut bytes)?;
    take::<Compensation>(&mut bytes)?;
    take::<Limits>(&mut bytes)?;
    take::<Option<CorrectionSpec>>(&mut bytes)?;
    take::<Option<WitnessSpec>>(&mut bytes)?;
    take::<Teach>(&mut bytes)?;
    take::<Vec<Closing, MAX_CLOSING, u8>>(&mut bytes)?;
    take::<Vec<Name, MAX_FIXED, u8>>(&mut bytes)?;
    for _ in ["fixed_mm", "nominal_distance_mm"] {
        take::<Option<f64>>(&mut bytes)?;
    }
    take::<Option<LearnedLimits>>(&mut bytes)?;
    let sigma = take::<Option<f64>>(&mut bytes)?;
    let rest = bytes.finalize().ok()?;
    Some(sigma.map(|_| job.len().saturating_sub(rest.len())))
}

type Bytes<'a> = Deserializer<'a, Slice<'a>>;

/// The value that comes next. Not inlined: it has room for one on its stack.
#[inline(never)]
fn take<'a, T: Deserialize<'a>>(bytes: &mut Bytes<'a>) -> Option<T> {
    T::deserialize(bytes).ok()
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
