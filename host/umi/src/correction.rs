//! Correction programs on the host: from a verdict of a journal, from a verdict that was
//! printed, or from a transform; in any dialect.

use std::path::Path;

use umi_core::nc::{self, Cleared, Figures};
use umi_core::registration::RigidTransform;
use umi_protocol::job::{CorrectionSpec, Job};
use umi_protocol::message::Record;
use umi_protocol::verdict::Verdict;

use crate::failure::{Explained, Failure};
use crate::points::name;
use crate::pull;
use crate::toolpath::{self, Source};

/// What a correction is made from.
#[derive(Debug)]
pub enum Basis {
    /// A verdict that a board reached, out of its journal, with the job.
    Judged(Box<(Job, Verdict)>),
    /// A transform, and where it is from. The program says that no board made it.
    Given(Source),
}

impl Basis {
    /// The verdict of a plate, or the last one: of a journal, or of `umi replay --json`.
    ///
    /// # Errors
    /// The file cannot be read or holds no such verdict, or the verdict is not OK.
    pub fn verdict(path: &Path, plate: Option<u32>) -> Result<Self, Failure> {
        let bytes = std::fs::read(path).map_err(|error| Failure::file("read", path, &error))?;
        if umi_core::journal::decode_file(&bytes).is_err() {
            if plate.is_some() {
                return Err(Failure::trouble("usage", "--plate is for a journal"));
            }
            return toolpath::verdict(path).map(Self::Given);
        }
        let mut job = None;
        let mut found = None;
        pull::read(&bytes, |entry| {
            match pull::record(&entry) {
                Ok(Record::JobSet(set)) => {
                    job = Some(set);
                    found = None;
                }
                Ok(Record::Verdict(verdict))
                    if plate.is_none_or(|plate| plate == verdict.plate) =>
                {
                    found = Some(verdict);
                }
                _ => {}
            }
            Ok(())
        })?;
        match (job, found) {
            (Some(job), Some(verdict)) => Ok(Self::Judged(Box::new((job, verdict)))),
            _ => Err(Failure::trouble(
                "verdict",
                format_args!("{}: no such verdict in it", name(path)),
            )),
        }
    }

    /// The correction that the job asks for.
    #[must_use]
    pub fn spec(&self) -> Option<CorrectionSpec> {
        match self {
            Self::Judged(judged) => judged.0.correction,
            Self::Given(_) => None,
        }
    }
}

/// A correction program.
#[derive(Clone, Debug)]
pub struct Made {
    /// The text, lines ended by LF.
    pub text: String,
    /// Largest error that it leaves at the part's corners.
    pub leftover_mm: f64,
}

/// Makes the program.
///
/// # Errors
/// The verdict is not OK; the dialect has not the place that is asked for; the numbers do not
/// fit its format; what would be left is more than the limit.
pub fn make(basis: &Basis, spec: &CorrectionSpec) -> Result<Made, Failure> {
    let dialect = spec.dialect.name();
    nc::dialect::check(spec).map_err(|field| {
        let place = field.name().trim_start_matches("correction.");
        Failure::trouble(
            "usage",
            format_args!("{dialect} has no such `{place}`; `umi dialects` lists what it has"),
        )
    })?;
    let not_expressible = |nc::NotExpressible| {
        Failure::refused(
            "not_expressible",
            format_args!("the correction does not fit the numbers of {dialect}"),
        )
    };
    let (transform, judged) = match basis {
        Basis::Given(source) => (source.transform, None),
        Basis::Judged(judged) => {
            let (job, verdict) = &**judged;
            let cleared = Cleared::by(verdict).ok_or_else(|| {
                let plate = verdict.plate;
                Failure::refused("not_ok", format_args!("the verdict on plate {plate} is NG"))
            })?;
            let Some(registration) = &verdict.registration else {
                return Err(Failure::refused(
                    "no_registration",
                    "the plate was taught: it is the reference, and nothing is to be corrected",
                ));
            };
            let [a, b, c] = registration.rotation;
            let transform = RigidTransform {
                rotation: nalgebra::Matrix3::from_rows(&[a.into(), b.into(), c.into()]),
                translation_mm: registration.translation_mm.into(),
            };
            let (turn_deg, tilt_deg) = transform.turn_and_tilt_deg();
            let figures = Figures {
                job: &job.name,
                plate: verdict.plate,
                rms_mm: registration.rms_mm,
                turn_deg,
                tilt_deg,
            };
            (transform, Some((cleared, figures)))
        }
    };
    let plan = nc::plan(spec, &transform).map_err(not_expressible)?;
    let leftover_mm = plan.leftover.0;
    if leftover_mm > spec.leftover_mm {
        return Err(Failure::Refused(
            Explained::new(
                "leftover",
                format_args!(
                    "{dialect} would leave {leftover_mm:.4} mm at the part's corners, limit {:.4} mm; \
                     `umi dialects` says which control can do more, `umi nc rewrite` needs none",
                    spec.leftover_mm
                ),
            )
            .with("leftover_mm", leftover_mm)
            .with("limit_mm", spec.leftover_mm),
        ));
    }
    let text = match (basis, &judged) {
        (_, Some((cleared, figures))) => nc::write(cleared, spec, &plan, figures),
        (Basis::Given(source), None) => nc::write_given(spec, &plan, &source.name),
        // `judged` is made of the basis.
        (Basis::Judged(_), None) => Err(nc::NotExpressible),
    }
    .map_err(not_expressible)?;
    Ok(Made {
        text: text.as_str().to_owned(),
        leftover_mm,
    })
}
