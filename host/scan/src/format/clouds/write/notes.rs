//! What whoever reads a file may take wrongly.

use std::path::Path;

/// A rounding below this is nothing beside what any scanner measures.
pub(super) const NOTHING_MM: f64 = 1e-4;

/// By how much a float (IEEE 754 binary32, 24 bits) rounds a coordinate of this size at most: half of its last bit.
pub(super) fn rounding_mm(mm: f64) -> f64 {
    if mm > 0.0 {
        mm.log2().floor().exp2() / f64::from(1 << 24)
    } else {
        0.0
    }
}

/// What is to be told of a cloud that was written: the unit where the format states none, how floats are rounded, and who
/// cannot read doubles. `double`: they were asked for; `farthest_mm`: the greatest coordinate, whichever its sign.
#[must_use]
pub fn notes(path: &Path, double: bool, farthest_mm: f64) -> Vec<String> {
    let is = |name: &str| {
        path.extension()
            .is_some_and(|extension| extension.eq_ignore_ascii_case(name))
    };
    let rounding_mm = rounding_mm(farthest_mm);
    let mut notes = Vec::new();
    if is("las") || is("laz") {
        notes.push(
            "LAS states no unit, and most programs take metres: these coordinates are millimetres."
                .into(),
        );
    }
    if is("pcd") && double {
        notes.push(
            "PCD with doubles: programs that look for floats (PointXYZ of the Point Cloud Library) find no x, y, z in it. \
             Without --double they do."
                .into(),
        );
    }
    if !double && rounding_mm > NOTHING_MM {
        if is("ply") {
            notes.push(format!(
                "The farthest coordinate is {farthest_mm:.0} mm: floats round there by up to {rounding_mm:.5} mm. The PLY has \
                 doubles if its first point lies beyond 2 m; --double asks for them."
            ));
        } else if is("pcd") || is("stl") {
            notes.push(format!(
                "The farthest coordinate is {farthest_mm:.0} mm: its floats are rounded by up to {rounding_mm:.5} mm. Move the \
                 origin to the part, or write .ply with --double."
            ));
        }
    }
    notes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rounding_is_the_greatest_that_a_float_makes() {
        for far in [0.7, 100.0, 1023.9, 2049.0, 5e4] {
            let most = rounding_mm(far);
            let mut seen = 0.0_f64;
            for k in 0..10_000 {
                let mm = far * (1.0 - f64::from(k) * 1e-9);
                seen = seen.max((f64::from(mm as f32) - mm).abs());
            }
            assert!(seen <= most && seen > 0.9 * most, "{far}: {seen} {most}");
        }
    }
}
