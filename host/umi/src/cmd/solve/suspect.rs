//! What shows that one list of points is no rigid image of the other: another unit or scale, a mirror,
//! another order, points that are elsewhere. A correction is not made by such a registration.

use umi_core::registration::{Registration, register};
use umi_core::units::Point;

/// A part that is warm, or a scan that is badly scaled, is off by less.
const MOST_SCALE: f64 = 0.02;
/// Points that are known so badly correct nothing: as a share of the part's size.
const MOST_RMS: f64 = 0.005;
/// The mirrored points, or those in the right order, fit so much better.
const BETTER: f64 = 0.05;
/// Orders of points that fit to this share of the size are not told apart by noise.
const LEAST_RMS: f64 = 1e-4;
/// Turns that differ by less are one.
const LEAST_TURN_DEG: f64 = 1.0;
/// Another order fits as well: not worse by more.
const AS_WELL: f64 = 3.0;
/// Points of which all orders are tried.
const MOST_ORDERED: usize = 7;

/// Why the lists do not belong together as they are. Points that are named are in their order.
pub(super) fn why(
    nominal: &[Point],
    measured: &[Point],
    registration: &Registration,
    are_named: bool,
) -> Option<String> {
    let rms_mm = registration.stats.rms.0;
    let (there, here) = (size(nominal), size(measured));
    let scale = here / there;
    let is_near = |factor: f64| (scale / factor - 1.0).abs() < MOST_SCALE;
    if is_near(25.4) || is_near(1.0 / 25.4) {
        return Some(format!(
            "the measured points lie {scale:.4} times as far apart as the nominal ones: one list \
             is in inches and the other in mm; write both in mm"
        ));
    }
    let smaller = there.min(here);
    let rms_of = |nominal: &[Point], measured: &[Point]| {
        register(nominal, measured).map_or(f64::INFINITY, |found| found.stats.rms.0)
    };
    let mirrored: Vec<Point> = nominal
        .iter()
        .map(|p| Point::from_mm(-p.mm.x, p.mm.y, p.mm.z))
        .collect();
    let mirrored_mm = rms_of(&mirrored, measured);
    // Of points in a plane a mirror image is a motion: half a turn about a line in it.
    let is_over = registration.transform.rotation[(2, 2)] < 0.0;
    let upside_down = (is_over && mirrored_mm <= MOST_SCALE * smaller).then(|| {
        "this turns the part upside down: in a list of points that lie nearly in a plane a lost sign, \
         or X and Y exchanged, looks like that; look at the signs and the order of the axes"
            .to_owned()
    });
    let least_mm = LEAST_RMS * smaller;
    if rms_mm <= least_mm {
        return upside_down.or_else(|| {
            (!are_named).then(|| turned(nominal, measured, registration, least_mm))?
        });
    }
    if rms_mm > MOST_SCALE * smaller && mirrored_mm < BETTER * rms_mm {
        return Some(format!(
            "the measured points are a mirror image of the nominal ones: mirrored, they fit to \
             {mirrored_mm:.4} mm; look at the signs of the axes"
        ));
    }
    if let Some((best, order)) = best_order(nominal, measured, |found| found.stats.rms.0)
        && best.stats.rms.0 < BETTER * rms_mm
    {
        return Some(format!(
            "the points are in another order: in the order {order} the measured ones fit to {:.4} mm, \
             as they stand to {rms_mm:.4} mm; write both lists in one order",
            best.stats.rms.0
        ));
    }
    if upside_down.is_some() {
        return upside_down;
    }
    if !is_near(1.0) && rms_mm > MOST_SCALE * smaller {
        return Some(format!(
            "the measured points lie {scale:.4} times as far apart as the nominal ones, and no \
             motion stretches: look at units, order and names of the points"
        ));
    }
    if rms_mm > MOST_RMS * smaller {
        return Some(format!(
            "the points are {rms_mm:.4} mm (rms) beside each other, {:.1} % of their distance from \
             their middle: look at the order of the points, and for one that is wrong",
            100.0 * rms_mm / smaller
        ));
    }
    (!are_named).then(|| turned(nominal, measured, registration, least_mm))?
}

/// Another order that fits as well and turns the part less, as of a square whose list begins at another
/// corner. A part that lies about as it should turns little.
fn turned(
    nominal: &[Point],
    measured: &[Point],
    registration: &Registration,
    least_mm: f64,
) -> Option<String> {
    let most_mm = AS_WELL * registration.stats.rms.0.max(least_mm);
    let (best, order) = best_order(nominal, measured, |found| {
        match found.stats.rms.0 <= most_mm {
            true => found.angle.0.abs(),
            false => f64::INFINITY,
        }
    })?;
    let angles_deg = [registration, &best].map(|found| found.angle.0.abs().to_degrees());
    let [angle_deg, best_deg] = angles_deg;
    (best.stats.rms.0 <= most_mm && best_deg + LEAST_TURN_DEG < angle_deg).then(|| {
        format!(
            "as the lists stand the part is turned by {angle_deg:.3} degrees, in the order {order} of the \
             measured points by {best_deg:.3}, and both fit ({:.4} and {:.4} mm): where the points stand \
             alike their order decides; look at it, and give both lists a column `name`",
            registration.stats.rms.0, best.stats.rms.0
        )
    })
}

/// The registration by the order of the measured points for which this is least, and the order in words.
fn best_order(
    nominal: &[Point],
    measured: &[Point],
    of: impl Fn(&Registration) -> f64,
) -> Option<(Registration, String)> {
    if measured.len() > MOST_ORDERED {
        return None;
    }
    let mut best: Option<(f64, Registration, Vec<usize>)> = None;
    each_order(measured.len(), &mut |order| {
        let ordered: Vec<Point> = order.iter().map(|place| measured[*place]).collect();
        let Ok(found) = register(nominal, &ordered) else {
            return;
        };
        let value = of(&found);
        if best.as_ref().is_none_or(|(least, ..)| value < *least) {
            best = Some((value, found, order.to_vec()));
        }
    });
    best.map(|(_, found, order)| {
        let order: Vec<String> = order.iter().map(|place| (place + 1).to_string()).collect();
        (found, order.join(" "))
    })
}

/// Root mean square distance from the middle, mm.
fn size(points: &[Point]) -> f64 {
    let n = points.len() as f64;
    let origin = Point::from_mm(0.0, 0.0, 0.0).mm;
    let sum = points.iter().fold(origin, |sum, p| sum + p.mm);
    let squares: f64 = points.iter().map(|p| (p.mm - sum / n).norm_squared()).sum();
    (squares / n).sqrt()
}

/// Each order of so many places, once (Heap, 1963).
fn each_order(n: usize, take: &mut impl FnMut(&[usize])) {
    fn exchange(k: usize, order: &mut [usize], take: &mut impl FnMut(&[usize])) {
        if k <= 1 {
            return take(order);
        }
        for place in 0..k {
            exchange(k - 1, order, take);
            order.swap(if k.is_multiple_of(2) { place } else { 0 }, k - 1);
        }
    }
    let mut order: Vec<usize> = (0..n).collect();
    exchange(n, &mut order, take);
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every order comes once.
    #[test]
    fn orders() {
        let mut seen = std::collections::BTreeSet::new();
        let mut count = 0;
        each_order(5, &mut |order| {
            count += 1;
            seen.insert(order.to_vec());
        });
        assert_eq!((count, seen.len()), (120, 120));
    }

    /// Each order of a plate's balls but the right one is told, and the right one is named; of a square
    /// those that turn it.
    #[test]
    fn another_order_is_told() {
        let plate: Vec<Point> = [
            [0.0, 0.0, 0.0],
            [100.0, 3.0, 0.0],
            [90.0, 80.0, 2.0],
            [-5.0, 70.0, 15.0],
        ]
        .map(Point::from_array_mm)
        .to_vec();
        let moved: Vec<Point> = plate
            .iter()
            .map(|p| Point::from_mm(4.0 - p.mm.y, p.mm.x + 7.0, p.mm.z + 1e-3 * (p.mm.x % 3.0)))
            .collect();
        let found = |a: &[Point], b: &[Point]| register(a, b).unwrap();
        let (mut told, mut right) = (0, 0);
        each_order(4, &mut |order| {
            let moved: Vec<Point> = order.iter().map(|place| moved[*place]).collect();
            match why(&plate, &moved, &found(&plate, &moved), false) {
                Some(said) => {
                    assert!(said.contains("another order"), "{said}");
                    told += 1;
                }
                None => right += 1,
            }
        });
        assert_eq!((told, right), (23, 1));
        let square: Vec<Point> = [
            [0.0, 0.0, 0.0],
            [50.0, 0.0, 0.0],
            [50.0, 50.0, 0.0],
            [0.0, 50.0, 0.0],
        ]
        .map(Point::from_array_mm)
        .to_vec();
        let probed: Vec<Point> = (0..)
            .zip(&square)
            .map(|(i, p)| Point::from_mm(p.mm.x + 0.004 * f64::from(i % 3), p.mm.y, p.mm.z))
            .collect();
        assert_eq!(why(&square, &probed, &found(&square, &probed), false), None);
        // Begun at another corner, it would turn by a quarter or a half; named, it does.
        for first in 1..4 {
            let mut shifted = probed.clone();
            shifted.rotate_left(first);
            for shifted in [shifted.clone(), shifted.iter().map(exact).collect()] {
                let registration = found(&square, &shifted);
                let said = why(&square, &shifted, &registration, false).unwrap();
                assert!(said.contains("column `name`"), "{said}");
                assert_eq!(why(&square, &shifted, &registration, true), None);
            }
        }
    }

    /// Without what was measured beside it.
    fn exact(p: &Point) -> Point {
        Point::from_mm(p.mm.x.round(), p.mm.y, p.mm.z)
    }

    /// A flat plate whose list has lost a sign, or has X and Y exchanged, fits as half a turn that
    /// stands it on its head: to the last digit, with noise, and with a ball that is a little off.
    #[test]
    fn a_flat_plate_upside_down_is_told() {
        let plate = |fourth_z: f64| {
            [
                [0.0, 0.0, 0.0],
                [100.0, 3.0, 0.0],
                [90.0, 80.0, 0.0],
                [-5.0, 70.0, fourth_z],
            ]
            .map(Point::from_array_mm)
            .to_vec()
        };
        type Read = fn(&Point) -> Point;
        let lost: Read = |p| Point::from_mm(-p.mm.x - 12.0, p.mm.y - 8.0, p.mm.z + 3.0);
        let exchanged: Read = |p| Point::from_mm(p.mm.y, p.mm.x, p.mm.z);
        let turned: Read = |p| Point::from_mm(4.0 - p.mm.x, 7.0 - p.mm.y, p.mm.z);
        for fourth_z in [0.0, 0.001, 0.5, 4.0, 30.0] {
            let nominal = plate(fourth_z);
            for (read, is_told) in [(lost, true), (exchanged, true), (turned, false)] {
                let measured: Vec<Point> = nominal.iter().map(read).collect();
                let found = register(&nominal, &measured).unwrap();
                let said = why(&nominal, &measured, &found, false);
                let is_named =
                    |said: &String| said.contains("upside down") || said.contains("mirror image");
                assert_eq!(
                    said.as_ref().is_some_and(is_named),
                    is_told,
                    "{fourth_z}: {said:?}"
                );
            }
        }
    }
}
