//! Options about work offsets, for all commands that follow a program's.

use clap::Args;
use umi_core::rewrite::MeasuredIn;
use umi_protocol::job::WorkOffset;

use crate::failure::Failure;

/// What is known of work offsets.
#[derive(Args)]
pub(crate) struct Offsets {
    /// The origin of a work offset in machine coordinates, as G55=250,0,-40 (repeatable):
    /// a part that is turned needs that of the offset in which the program runs and of the one in
    /// which it was probed, where they are two
    #[arg(long, value_name = "G54=X,Y,Z", value_parser = origin)]
    origin: Vec<(usize, [f64; 3])>,
    /// The work offset in whose coordinates the part was probed, as G54 or G54.1P7. By itself that
    /// of the verdict's job; with --transform the one at the program's first motion
    #[arg(long, value_name = "OFFSET", value_parser = offset)]
    probed_in: Option<WorkOffset>,
}

fn origin(text: &str) -> Result<(usize, [f64; 3]), String> {
    let parsed = || {
        let (name, place) = text.split_once('=')?;
        let number: usize = name.trim_start_matches(['G', 'g']).parse().ok()?;
        let index = number.checked_sub(54).filter(|index| *index < 6)?;
        let numbers: Result<Vec<f64>, _> = place.split(',').map(|x| x.trim().parse()).collect();
        let place: [f64; 3] = numbers.ok()?.try_into().ok()?;
        place
            .iter()
            .all(|mm| mm.is_finite())
            .then_some((index, place))
    };
    parsed().ok_or_else(|| "give it as G54=100,-250,-40.5 (G54 to G59, mm)".into())
}

/// A work offset by its name.
pub(crate) fn offset(text: &str) -> Result<WorkOffset, String> {
    let text = text.to_ascii_uppercase().replace(' ', "");
    Ok(match text.as_str() {
        "G54" => WorkOffset::G54,
        "G55" => WorkOffset::G55,
        "G56" => WorkOffset::G56,
        "G57" => WorkOffset::G57,
        "G58" => WorkOffset::G58,
        "G59" => WorkOffset::G59,
        other => {
            let further = ["G54.1P", "G154P"];
            let digits = further.iter().find_map(|name| other.strip_prefix(name));
            // A Sinumerik's G505 to G599 have two digits behind: G51 is no offset.
            let siemens = other.strip_prefix("G5").filter(|digits| digits.len() == 2);
            let number = digits.or(siemens).and_then(|digits| digits.parse().ok());
            WorkOffset::Extended(
                number
                    .filter(|n| *n > 0)
                    .ok_or("give G54 to G59, G54.1P7, G154P7 or G507")?,
            )
        }
    })
}

/// Where a transform holds, and the origins of G54 to G59 that are known.
type Known = (Option<MeasuredIn>, [Option<[f64; 3]>; 6]);

impl Offsets {
    /// The offset in which the options say that the part was probed, and its origin among them.
    pub fn stated(&self) -> Option<MeasuredIn> {
        let offset = self.probed_in?;
        let index = usize::from(offset.p_number()).checked_sub(1)?;
        let is_further = matches!(offset, WorkOffset::Extended(_));
        let known = self.origin.iter().find(|(of, _)| *of == index);
        Some(MeasuredIn {
            offset,
            origin_mm: known.filter(|_| !is_further).map(|(_, place)| *place),
        })
    }

    /// Where a transform holds, and the origins of G54 to G59 that are known.
    ///
    /// # Errors
    /// What is given contradicts itself, or where the part was probed.
    pub fn of(&self, measured_in: Option<MeasuredIn>) -> Result<Known, Failure> {
        let usage = |why: std::fmt::Arguments<'_>| Err(Failure::trouble("usage", why));
        let measured_in = match (self.probed_in, measured_in) {
            (
                Some(given),
                Some(MeasuredIn {
                    offset,
                    origin_mm: Some(_),
                }),
            ) if given != offset => {
                return usage(format_args!(
                    "--probed-in says {given}, and the part of the verdict was probed in {offset}: \
                     leave the option out"
                ));
            }
            (Some(offset), measured_in) => Some(MeasuredIn {
                offset,
                origin_mm: measured_in.and_then(|it| it.origin_mm),
            }),
            (None, measured_in) => measured_in,
        };
        let mut origins_mm = [None; 6];
        if let Some((index, origin_mm)) = measured_in.and_then(|it| it.known_origin())
            && let Some(slot) = origins_mm.get_mut(index)
        {
            *slot = Some(origin_mm);
        }
        for (index, place) in &self.origin {
            let Some(slot) = origins_mm.get_mut(*index) else {
                continue;
            };
            if let Some([x, y, z]) = slot.filter(|known| known != place) {
                return usage(format_args!(
                    "--origin G{}: its origin is given as {x},{y},{z}, too: by another --origin, or \
                     by the job's `probed_origin_mm`",
                    54 + index
                ));
            }
            *slot = Some(*place);
        }
        Ok((measured_in, origins_mm))
    }
}
