//! Binary STL of the grid that profiles and places in them make: two triangles between four
//! neighbours, or one between three. Where a point, a profile or the surface is missing, the mesh has a
//! hole.

use std::io::{BufWriter, Write};

use super::CloudStyle;
use super::counted::Counted;
use crate::ScanError;
use crate::format::partial::Partial;
use crate::rigid::Vec3;

/// An edge longer than so many times the usual diagonal of the grid does not lie on the surface.
const LONGEST: f64 = 4.0;

/// A point by its profile and its place in it.
type Knot = ((u64, u32), Vec3);

pub(super) fn write(
    partial: &Partial,
    style: CloudStyle,
    points: &mut Counted<'_>,
) -> Result<(), ScanError> {
    let no_grid = |what: &str| Err(ScanError::refused("no_grid", what));
    if !(style.columns.profile && style.columns.index) {
        return no_grid(
            "A mesh is made of the grid of one view: the cloud needs its profiles and the places in \
             them (columns profile and index). `umi scan merge --profiles-too` writes them to a PLY.",
        );
    }
    let mut knots: Vec<Knot> = Vec::new();
    while let Some(p) = points.next_point()? {
        knots.push(((p.profile, p.index), Vec3::from(p.at)));
    }
    knots.sort_by_key(|knot| knot.0);
    if knots.windows(2).any(|pair| pair[0].0 == pair[1].0) {
        return no_grid(
            "Two points have the same profile and place: a mesh is made of the grid of one view.",
        );
    }
    let longest_mm = style
        .longest_mm
        .or_else(|| usual_diagonal(&knots).map(|mm| LONGEST * mm));
    let triangles = longest_mm.map_or_else(Vec::new, |mm| triangles(&knots, mm));
    // Sorted: neighbours of a profile follow each other.
    let follow = |pair: &[Knot]| {
        let [((profile, index), _), ((of, next), _)] = [pair[0], pair[1]];
        profile == of && next - index == 1
    };
    if triangles.is_empty() && knots.len() > 2 && !knots.windows(2).any(follow) {
        return no_grid(
            "No two points of a profile have indices that follow each other: a mesh needs neighbours. \
             Thinning takes them away (`umi scan sample`, an earlier filter): make the mesh of the whole cloud.",
        );
    }
    if triangles.is_empty() {
        return no_grid("No three neighbours of the grid are near each other: there is no mesh.");
    }
    let count = u32::try_from(triangles.len())
        .map_err(|_| ScanError::refused("no_grid", "STL holds 2^32 triangles at most."))?;
    let io = |error: std::io::Error| partial.failed(&error);
    let mut out = BufWriter::with_capacity(1 << 20, partial.begin()?);
    let mut header = [b' '; 80];
    let title = b"single view as a grid, mm";
    header[..title.len()].copy_from_slice(title);
    out.write_all(&header).map_err(io)?;
    out.write_all(&count.to_le_bytes()).map_err(io)?;
    // One side of one view: up, by most of the surface.
    let up: f64 = triangles
        .iter()
        .map(|[a, b, c]| (b - a).cross(&(c - a)).z)
        .sum();
    for [a, b, c] in &triangles {
        let (b, c) = if up < 0.0 { (c, b) } else { (b, c) };
        let normal = (b - a).cross(&(c - a));
        let normal = normal.try_normalize(0.0).unwrap_or_else(Vec3::zeros);
        for value in [&normal, a, b, c].into_iter().flat_map(|v| v.iter()) {
            out.write_all(&(*value as f32).to_le_bytes()).map_err(io)?;
        }
        out.write_all(&[0, 0]).map_err(io)?;
    }
    out.flush().map_err(io)
}

/// Where a point of the grid stands, if it is there.
fn at(knots: &[Knot], profile: u64, index: u32) -> Option<Vec3> {
    let found = knots.binary_search_by_key(&(profile, index), |knot| knot.0);
    found.ok().map(|place| knots[place].1)
}

/// The diagonal of the middle pitches along and across the profiles.
fn usual_diagonal(knots: &[Knot]) -> Option<f64> {
    let mut pitches = [Vec::new(), Vec::new()];
    for ((profile, index), here) in knots {
        let along = index.checked_add(1).and_then(|i| at(knots, *profile, i));
        let across = profile.checked_add(1).and_then(|p| at(knots, p, *index));
        for (pitches, there) in pitches.iter_mut().zip([along, across]) {
            pitches.extend(there.map(|there| (there - here).norm()));
        }
    }
    let [along, across] = pitches.map(|mut pitches| {
        let middle = pitches.len() / 2;
        (!pitches.is_empty()).then(|| *pitches.select_nth_unstable_by(middle, f64::total_cmp).1)
    });
    Some(along?.hypot(across?))
}

fn triangles(knots: &[Knot], longest_mm: f64) -> Vec<[Vec3; 3]> {
    let mut found = Vec::new();
    let mut take = |three: [Option<Vec3>; 3]| {
        let [Some(a), Some(b), Some(c)] = three else {
            return;
        };
        let near = |a: &Vec3, b: &Vec3| (a - b).norm() <= longest_mm;
        let flat = (b - a).cross(&(c - a)).norm() == 0.0;
        if near(&a, &b) && near(&b, &c) && near(&c, &a) && !flat {
            found.push([a, b, c]);
        }
    };
    for ((profile, index), here) in knots {
        let (Some(next), Some(below)) = (profile.checked_add(1), index.checked_add(1)) else {
            continue;
        };
        let corner = *here;
        let here = Some(corner);
        let (right, down) = (at(knots, next, *index), at(knots, *profile, below));
        let across = at(knots, next, below);
        match (right, down, across) {
            (Some(r), Some(d), Some(x)) => {
                // The shorter diagonal: the other one would cut through an edge.
                if (r - d).norm() <= (x - corner).norm() {
                    take([here, right, down]);
                    take([right, across, down]);
                } else {
                    take([here, right, across]);
                    take([here, across, down]);
                }
            }
            (None, _, _) => take([here, across, down]),
            (_, None, _) => take([here, right, across]),
            (_, _, None) => take([here, right, down]),
        }
        // The fourth corner has no knot of its own place to begin at where this one is missing.
        if index
            .checked_sub(1)
            .is_some_and(|i| at(knots, *profile, i).is_none())
        {
            let before = index - 1;
            take([here, at(knots, next, before), right]);
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use crate::cloud::{CloudColumns, CloudPoint};
    use crate::format::clouds::write::{CloudStyle, write_cloud};
    use crate::surface::read_stl;

    fn grid(without: &[(u64, u32)]) -> Vec<CloudPoint> {
        (0..6_u64)
            .flat_map(|profile| (0..8_u32).map(move |index| (profile, index)))
            .filter(|place| !without.contains(place))
            .map(|(profile, index)| CloudPoint {
                // A step of 40 mm between the third profile and the fourth.
                at: [
                    0.1 * f64::from(index),
                    0.2 * profile as f64,
                    if profile < 3 { 0.0 } else { 40.0 },
                ],
                profile,
                index,
                ..CloudPoint::default()
            })
            .collect()
    }

    fn style(grid: bool) -> CloudStyle {
        CloudStyle {
            columns: CloudColumns {
                profile: grid,
                index: grid,
                ..CloudColumns::default()
            },
            ..CloudStyle::default()
        }
    }

    fn path(name: &str) -> PathBuf {
        std::env::temp_dir().join(format!("umi-grid-{name}-{}.stl", std::process::id()))
    }

    #[test]
    fn a_grid_is_a_mesh_with_its_holes() {
        let path = path("holes");
        // Whole: 2 and 2 rows of 7 cells, the step open. Without an inner point two of eight triangles
        // about it stay, one for each of the corners that it was not of; without one at the border.
        for (without, count) in [
            (&[][..], 2 * 2 * 2 * 7),
            (&[(1, 3)], 56 - 4),
            (&[(0, 0)], 56 - 1),
            (&[(5, 7)], 56 - 1),
            (&[(2, 7)], 56 - 1),
            (
                &[
                    (4, 0),
                    (4, 1),
                    (4, 2),
                    (4, 3),
                    (4, 4),
                    (4, 5),
                    (4, 6),
                    (4, 7),
                ],
                28,
            ),
        ] {
            let points = grid(without).into_iter().map(Ok);
            write_cloud(&path, style(true), Box::new(points)).unwrap();
            let bytes = std::fs::read(&path).unwrap();
            assert_eq!(bytes.len(), 84 + 50 * count, "{without:?}");
            let mesh = read_stl(&path).unwrap();
            assert!(
                mesh.triangles().iter().all(|t| t.normal.z > 0.99),
                "{without:?}"
            );
            assert!((mesh.area_mm2() - 0.01 * count as f64).abs() < 1e-4);
        }
        std::fs::remove_file(&path).unwrap();
    }

    #[test]
    fn what_is_no_grid_is_refused() {
        let path = path("none");
        let code = |points: Vec<CloudPoint>, of: bool| {
            let points = points.into_iter().map(Ok);
            write_cloud(&path, style(of), Box::new(points))
                .unwrap_err()
                .code
        };
        assert_eq!(code(grid(&[]), false), "no_grid");
        assert_eq!(code([grid(&[]), grid(&[])].concat(), true), "no_grid");
        assert_eq!(code(grid(&[])[..8].to_vec(), true), "no_grid");
        // Each second point: no neighbours are left, and that is the reason that is told.
        let mut thinned = grid(&[]);
        thinned.retain(|p| p.index % 2 == 0);
        let thinned = thinned.into_iter().map(Ok);
        let error = write_cloud(&path, style(true), Box::new(thinned)).unwrap_err();
        assert!(error.to_string().contains("Thinning"), "{error}");

        assert!(!path.exists());
    }
}
