//! Numbers in columns: CSV with `x,y,z`, or the same parted by semicolons, tabs or spaces.

use crate::ScanError;
use crate::cloud::ScanCloud;
use crate::rigid::Vec3;

pub(super) fn read(bytes: &[u8]) -> Result<ScanCloud, ScanError> {
    let mut cloud = ScanCloud::default();
    let mut places = None;
    for (i, line) in bytes.split(|&b| b == b'\n').enumerate() {
        let wrong =
            |what: &str| ScanError::unreadable("bad_file", format_args!("line {}: {what}", i + 1));
        let line = std::str::from_utf8(line)
            .map_err(|_| wrong("it is not text, and no PLY file either"))?;
        let line = line.trim().trim_start_matches('\u{feff}');
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let cells = cells(line);
        let Some(places) = places else {
            // The first line: names of columns, or already numbers.
            if cells.iter().all(|cell| cell.parse::<f64>().is_ok()) {
                places = Some([0, 1, 2]);
                cloud.push(
                    point(&cells, [0, 1, 2])
                        .ok_or_else(|| wrong("it needs three numbers: x,y,z in mm"))?,
                );
            } else {
                places = Some(named(&cells).ok_or_else(|| {
                    wrong("it is neither three numbers nor a header with the columns x,y,z")
                })?);
            }
            continue;
        };
        cloud.push(
            point(&cells, places)
                .ok_or_else(|| wrong("it needs a number in each of the columns x,y,z"))?,
        );
    }
    if places.is_none() {
        return Err(ScanError::unreadable(
            "bad_file",
            "it holds no points: neither a PLY header nor a line x,y,z",
        ));
    }
    Ok(cloud)
}

fn cells(line: &str) -> Vec<&str> {
    for parting in [',', ';', '\t'] {
        if line.contains(parting) {
            return line.split(parting).map(str::trim).collect();
        }
    }
    line.split_ascii_whitespace().collect()
}

fn point(cells: &[&str], places: [usize; 3]) -> Option<Vec3> {
    let number = |place: usize| cells.get(place)?.parse::<f64>().ok();
    Some(Vec3::new(
        number(places[0])?,
        number(places[1])?,
        number(places[2])?,
    ))
}

/// Which columns are x, y, z; `x_mm` and `"X"` are meant too.
fn named(cells: &[&str]) -> Option<[usize; 3]> {
    let place = |axis: &str| {
        cells.iter().position(|cell| {
            let name = cell.trim_matches('"').to_ascii_lowercase();
            name.strip_suffix("_mm").unwrap_or(&name) == axis
        })
    };
    Some([place("x")?, place("y")?, place("z")?])
}
