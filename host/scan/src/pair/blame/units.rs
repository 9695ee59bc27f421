//! Times in another unit than their column says, by the rates of both trains.
//!
//! # Design
//! The median intervals differ by the factor of the units, where there is one. The factor that is next to their ratio is
//! tried: it is named where the trains agree with it and no shift explains as many profiles without it. So an honest scan
//! is never refused, however its intervals fall.

use crate::ScanError;
use crate::pair::search::{Reaches, reaches};
use crate::pair::streams::{Reach, Streams};
use crate::pair::trains::median_interval;

/// Steps of a search that only says why: a part of a second.
const STEPS: u64 = 200_000_000;
/// Fewer pairs agree with a wrong unit by chance.
const FEWEST: usize = 8;
/// A Gocator's clock counts so many times as fast as microseconds pass.
const TICKS: f64 = 1.024;

/// What the profiles' times must be multiplied by, and in words.
const UNITS: [(f64, &str); 8] = [
    (1.0 / TICKS, "divided by 1.024: they are a Gocator's ticks"),
    (
        TICKS,
        "times 1.024: they were divided by 1.024, though they were microseconds",
    ),
    (1e3, "times 1000: they are milliseconds"),
    (1e6, "times 1000000: they are seconds"),
    (
        1e-3,
        "divided by 1000: they are nanoseconds, or the latches' t_ns are microseconds",
    ),
    (
        1e-6,
        "divided by 1000000: the latches' t_ns are milliseconds",
    ),
    (1e-9, "divided by 1e9: the latches' t_ns are seconds"),
    (
        1e3 / TICKS,
        "times 1000 and divided by 1.024: they are thousands of a Gocator's ticks",
    ),
];

/// That the times have another unit, where their rates and a pairing say so; before the long search.
pub(in crate::pair) fn other_unit(streams: &Streams<'_>) -> Option<ScanError> {
    let (sensor_us, board_us) = rates(streams)?;
    let off = |factor: f64| (board_us / sensor_us / factor).ln().abs();
    let (factor, what) = UNITS
        .into_iter()
        .min_by(|a, b| off(a.0).total_cmp(&off(b.0)))
        .filter(|(factor, _)| off(*factor) < off(1.0))?;
    let scaled = streams.within_reach(factor).trains;
    let Reaches::Yes(explained) = reaches(&scaled, scaled.need().max(FEWEST), STEPS) else {
        return None;
    };
    let as_they_are = streams.within_reach(1.0).trains;
    let none = reaches(&as_they_are, explained, STEPS) == Reaches::No;
    none.then(|| {
        ScanError::refused(
            "no_match",
            format_args!(
                "the unit of the times is wrong: the profiles' times fit {what}. The median interval is {} µs by the profiles' \
                 t_us and {} µs by the latches' t_ns, and no shift of the clocks explains as many as {explained} profiles without \
                 that",
                figure(sensor_us),
                figure(board_us),
            ),
        )
        .with("factor", factor)
    })
}

/// What the times say where nothing matches: other units that would, and rates that differ; and the factor of the first.
pub(in crate::pair) fn hints(streams: &Streams<'_>, reach: &Reach) -> (String, Option<f64>) {
    let (mut why, mut first) = (String::new(), None);
    for (factor, what) in UNITS {
        let scaled = streams.within_reach(factor).trains;
        let least = scaled.need().max(FEWEST);
        if matches!(reaches(&scaled, least, STEPS), Reaches::Yes(_)) {
            why += &format!("; the profiles' times fit {what}");
            first = first.or(Some(factor));
        }
    }
    if let Some((sensor_us, board_us)) = rates(streams).filter(|_| !reach.trains.could_pair()) {
        why += &format!(
            "; the median interval is {} µs by the profiles' t_us and {} µs by the latches' t_ns: look at the unit of each",
            figure(sensor_us),
            figure(board_us)
        );
    }
    (why, first)
}

/// The median intervals of the profiles and of the latches, if both run.
fn rates(streams: &Streams<'_>) -> Option<(f64, f64)> {
    let mut sensor: Vec<f64> = streams.sensor_us().collect();
    sensor.sort_by(f64::total_cmp);
    let rates = (
        median_interval(&sensor)?,
        median_interval(&streams.board_us())?,
    );
    (rates.0 > 0.0 && rates.1 > 0.0).then_some(rates)
}

/// Four digits.
fn figure(us: f64) -> String {
    let digits = (3.0 - us.log10().floor()).clamp(0.0, 9.0) as usize;
    format!("{us:.digits$}")
}
