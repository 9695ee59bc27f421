//! Damaged files, slivers and huge coordinates: readers and planner refuse by name, never panic, and end in time.
//!
//! `UMI_DAMAGE_RUNS=100000 cargo test --release -p umi-scan damage` does as many of each; `UMI_DAMAGE_FIRST` begins at another
//! number.

use std::path::Path;
use std::time::{Duration, Instant};

use nalgebra::Vector3;

use super::super::mesh::read::from_bytes;
use super::super::mesh::{PartMesh, RawMesh};
use super::super::planner::{PlanOptions, plan};
use super::super::spec::ScanSpec;

/// Longer than this no run may last beyond its limit: a machine that does much else counts, too.
const GRACE: Duration = Duration::from_secs(10);

struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    fn below(&mut self, end: usize) -> usize {
        (self.next() >> 11) as usize % end.max(1)
    }

    /// From -1 to 1.
    fn share(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }
}

/// The numbers of the runs.
fn runs(few: u64) -> std::ops::Range<u64> {
    let number = |name: &str| std::env::var(name).ok().map(|text| text.parse().unwrap());
    let first = number("UMI_DAMAGE_FIRST").unwrap_or(0);
    first..first + number("UMI_DAMAGE_RUNS").unwrap_or(few)
}

/// A wavy sheet, sometimes with a second one beside it, sometimes with a thickness.
fn sheet(random: &mut Random) -> RawMesh {
    let cells = 1 + random.below(4);
    let mut raw = RawMesh::default();
    let thick = random.below(3) == 0;
    for layer in 0..1 + usize::from(thick) {
        let first = raw.vertices.len();
        for i in 0..=cells {
            for j in 0..=cells {
                let (x, y) = (i as f64 * 6.0, j as f64 * 6.0);
                let z = (x / 9.0).sin() * (y / 11.0).cos() * 3.0 - 20.0 * layer as f64;
                raw.vertices.push(Vector3::new(x, y, z));
            }
        }
        for i in 0..cells {
            for j in 0..cells {
                let number = |i: usize, j: usize| first + i * (cells + 1) + j;
                let [a, b, c, d] = [
                    number(i, j),
                    number(i + 1, j),
                    number(i + 1, j + 1),
                    number(i, j + 1),
                ];
                for [a, b, c] in [[a, b, c], [a, c, d]] {
                    raw.faces
                        .push(if layer == 0 { [a, b, c] } else { [a, c, b] });
                }
            }
        }
    }
    raw
}

fn stl(raw: &RawMesh) -> Vec<u8> {
    let mut bytes = vec![0; 80];
    bytes.extend((raw.faces.len() as u32).to_le_bytes());
    for f in &raw.faces {
        bytes.extend([0; 12]);
        for v in f.iter().flat_map(|k| raw.vertices[*k].iter()) {
            bytes.extend((*v as f32).to_le_bytes());
        }
        bytes.extend([0; 2]);
    }
    bytes
}

fn stl_text(raw: &RawMesh) -> Vec<u8> {
    let mut text = String::from("solid s\n");
    for f in &raw.faces {
        text.push_str("facet normal 0 0 1\nouter loop\n");
        for v in f.map(|k| raw.vertices[k]) {
            text.push_str(&format!("vertex {} {} {}\n", v.x, v.y, v.z));
        }
        text.push_str("endloop\nendfacet\n");
    }
    (text + "endsolid s\n").into_bytes()
}

fn obj(raw: &RawMesh) -> Vec<u8> {
    let mut text = String::new();
    for v in &raw.vertices {
        text.push_str(&format!("v {} {} {}\n", v.x, v.y, v.z));
    }
    for f in &raw.faces {
        text.push_str(&format!("f {} {} {}\n", f[0] + 1, f[1] + 1, f[2] + 1));
    }
    text.into_bytes()
}

fn ply(raw: &RawMesh, binary: bool) -> Vec<u8> {
    let mut bytes = format!(
        "ply\nformat {} 1.0\nelement vertex {}\nproperty double x\nproperty double y\nproperty double z\n\
         element face {}\nproperty list uchar int vertex_indices\nend_header\n",
        if binary { "binary_little_endian" } else { "ascii" },
        raw.vertices.len(),
        raw.faces.len()
    )
    .into_bytes();
    for v in &raw.vertices {
        if binary {
            bytes.extend(v.iter().flat_map(|x| x.to_le_bytes()));
        } else {
            bytes.extend(format!("{} {} {}\n", v.x, v.y, v.z).bytes());
        }
    }
    for f in &raw.faces {
        if binary {
            bytes.push(3);
            bytes.extend(f.iter().flat_map(|k| (*k as u32).to_le_bytes()));
        } else {
            bytes.extend(format!("3 {} {} {}\n", f[0], f[1], f[2]).bytes());
        }
    }
    bytes
}

/// What stands in a damaged file in place of a word.
const WORDS: [&str; 16] = [
    "nan",
    "inf",
    "-1e308",
    "1e-320",
    "0",
    "-1",
    "4294967296",
    "1e9",
    "99999999999999999999",
    "$",
    "",
    "*",
    "'",
    "#1",
    "()",
    "9e99",
];

fn damage(bytes: &mut Vec<u8>, random: &mut Random) {
    for _ in 0..1 + random.below(4) {
        if bytes.is_empty() {
            return;
        }
        let at = random.below(bytes.len());
        let length = 1 + random.below(40.min(bytes.len() - at));
        match random.below(7) {
            0 => bytes[at] ^= 1 << random.below(8),
            1 => bytes[at] = random.next() as u8,
            2 => drop(bytes.drain(at..at + length)),
            3 => {
                let again = bytes[at..at + length].to_vec();
                bytes.splice(at..at, again);
            }
            4 => bytes.truncate(at),
            5 => {
                // A word of a text, or as many bytes as it has.
                let end = (at..bytes.len())
                    .find(|k| b" \n,)".contains(&bytes[*k]))
                    .unwrap_or(bytes.len());
                let word = WORDS[random.below(WORDS.len())].bytes();
                bytes.splice(at..end, word);
            }
            _ => {
                let number = [f32::NAN, f32::INFINITY, 1e38, 1e-40, -0.0, 3e7][random.below(6)];
                for (k, b) in number.to_le_bytes().into_iter().enumerate() {
                    if let Some(slot) = bytes.get_mut((at & !1) + k) {
                        *slot = b;
                    }
                }
            }
        }
    }
}

#[test]
fn damaged_files_are_read_or_refused() {
    let step = include_bytes!("../../../../../tests/reference/plan/step_wavy.step");
    let (mut read, mut longest) = (0, Duration::ZERO);
    for run in runs(1500) {
        let mut random = Random(0x9e37_79b9_7f4a_7c15 ^ (run + 1));
        random.next();
        let raw = sheet(&mut random);
        let (extension, mut bytes) = match random.below(if run % 8 == 0 { 6 } else { 5 }) {
            0 => ("stl", stl(&raw)),
            1 => ("stl", stl_text(&raw)),
            2 => ("obj", obj(&raw)),
            3 => ("ply", ply(&raw, false)),
            4 => ("ply", ply(&raw, true)),
            _ => ("step", step.to_vec()),
        };
        damage(&mut bytes, &mut random);
        let begun = Instant::now();
        let found = from_bytes(extension, &bytes).and_then(|raw| PartMesh::weld(raw, true));
        longest = longest.max(begun.elapsed());
        match found {
            Ok(_) => read += 1,
            Err(e) => assert!(e.code.starts_with("mesh_"), "run {run}: {}", e.code),
        }
        assert!(longest < GRACE, "run {run}: {longest:?}");
    }
    println!("{read} were read; the longest took {longest:?}");
    assert!(read > 0);
}

/// Vertices are moved: onto each other, far away, together to slivers, to what is no number.
fn distort(raw: &mut RawMesh, random: &mut Random) {
    for _ in 0..random.below(4) {
        let (a, b) = (
            random.below(raw.vertices.len()),
            random.below(raw.vertices.len()),
        );
        let other = raw.vertices[b];
        let v = &mut raw.vertices[a];
        match random.below(9) {
            0 => *v = other,
            1 => *v += (other - *v) * (1.0 - 1e-9),
            2 => v.z += random.share() * 1e3,
            3 => v.x = random.share() * 1e6,
            4 => *v *= 1e5,
            5 => v.y = [f64::NAN, f64::INFINITY, 1e300, -1e19, 1e-300][random.below(5)],
            6 => v.z += random.share() * 8.0,
            7 => {
                let k = random.below(raw.faces.len());
                raw.faces[k].swap(0, 1);
            }
            _ => {
                let k = random.below(raw.faces.len());
                raw.faces.swap_remove(k);
                if raw.faces.is_empty() {
                    raw.faces.push([0, 1, 2]);
                }
            }
        }
    }
    if random.below(4) == 0 {
        let size = [1e-6, 1e-3, 0.05, 20.0, 1e4, 1e9][random.below(6)];
        let shift = [0.0, 0.0, 3e4, 1e8][random.below(4)];
        for v in &mut raw.vertices {
            *v = *v * size + Vector3::repeat(shift);
        }
    }
}

#[test]
fn a_plan_of_a_damaged_mesh_is_proved_or_refused_within_its_time() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/reference/plan");
    let text = std::fs::read_to_string(folder.join("kinematics_ac.toml")).unwrap();
    let standing: String = text
        .lines()
        .filter(|l| !l.starts_with("spindle"))
        .map(|l| format!("{l}\n"))
        .collect();
    let specs = [text.clone(), standing].map(|text| ScanSpec::read(&text, Path::new("")).unwrap());
    let (mut planned, mut late, mut unproved) = (0, 0, 0);
    let mut longest = Duration::ZERO;
    for run in runs(40) {
        // Most end with their time, at one place or another; some are given enough.
        let limit = Duration::from_millis(if run % 10 == 0 { 1500 } else { 40 });
        let mut random = Random(0xd1b5_4a32_d192_ed03 ^ (run + 1));
        random.next();
        let mut raw = sheet(&mut random);
        distort(&mut raw, &mut random);
        if super::super::mesh::weld::check_finite(&raw).is_err() {
            continue;
        }
        let Ok(part) = PartMesh::weld(raw, true) else {
            continue;
        };
        let options = PlanOptions {
            allow_partial: run % 2 == 0,
            time_limit: limit,
            feed_mm_per_min: 600.0,
        };
        let begun = Instant::now();
        let found = plan(&part, &[], &specs[run as usize % 2], options);
        longest = longest.max(begun.elapsed());
        match found {
            Ok(_) => planned += 1,
            Err(e) => {
                late += u32::from(e.code == "time_limit");
                // Sheets that lie in each other have two normals at one place: the proof refuses what the search took.
                unproved += u32::from(e.code == "plan_unproved");
                assert!(
                    [
                        "time_limit",
                        "coverage_unreachable",
                        "overlap_unreachable",
                        "axis_limit",
                        "plan_unproved"
                    ]
                    .contains(&e.code),
                    "run {run}: {} {}",
                    e.code,
                    e.message
                );
            }
        }
        assert!(
            longest < limit + GRACE,
            "run {run}, {} triangles: {longest:?}",
            part.faces.len()
        );
    }
    println!(
        "{planned} were planned, {late} ended with their time, {unproved} were not proved; the longest took {longest:?}"
    );
    assert!(unproved <= 1 + planned / 20);
    assert!(planned + late > 0 || std::env::var_os("UMI_DAMAGE_FIRST").is_some());
}

#[test]
fn a_crowd_of_strips_ends_in_time() {
    // Three quarters of a tube on a table that turns about X and Z: some directions have thousands of courses.
    let mut raw = RawMesh::default();
    for k in 0..=40 {
        let (s, c) = (225.0 - 6.75 * f64::from(k)).to_radians().sin_cos();
        for j in 0..=12 {
            let y = f64::from(j) / 12.0 * 80.0 - 40.0;
            raw.vertices.push(Vector3::new(20.0 * c, y, 20.0 * s));
        }
    }
    for k in 0..40 {
        for j in 0..12 {
            let a = k * 13 + j;
            raw.faces.push([a, a + 13, a + 14]);
            raw.faces.push([a, a + 14, a + 1]);
        }
    }
    let part = PartMesh::weld(raw, true).unwrap();
    // No spindle turns the line: it follows from the table's angles.
    let spec = "[part]\n[sensor]\nline_mm = 16.0\nreference_mm = 60.0\nrange_mm = [52.0, 68.0]\nmax_incidence_deg = 60.0\n\
                receiver_mm = [0, 30, -10]\nbody_mm = [[-20, -20, -100], [20, 60, -5]]\n[plan]\noverlap = 0.15\n\
                stand_off_tolerance_mm = 1.0\nmax_tilt_deg = 10.0\nmin_coverage = 0.3\nclearance_mm = 3.0\nmax_step_mm = 2.0\n\
                max_turn_deg = 6.0\n[machine]\ntravel_mm = { X = [-900, 900], Y = [-900, 900], Z = [-900, 900] }\n\
                mount = { origin_mm = [0, 0, -150.0], beam = [0, 0, -1.0], line = [0, 1.0, 0] }\n\
                [[machine.table]]\nname = \"A\"\naxis = [1, 0, 0]\npoint_mm = [0, 0, -50]\nlimits_deg = [-95, 95]\n\
                [[machine.table]]\nname = \"C\"\naxis = [0, 0, 1]\npoint_mm = [0, 0, 0]\nlimits_deg = [-360, 360]\n";
    let spec = ScanSpec::read(spec, Path::new("")).unwrap();
    let limit = Duration::from_secs(5);
    let asked = PlanOptions {
        allow_partial: true,
        time_limit: limit,
        feed_mm_per_min: 600.0,
    };
    let begun = Instant::now();
    if let Err(refusal) = plan(&part, &[], &spec, asked) {
        assert_eq!(refusal.code, "time_limit", "{refusal}");
    }
    let took = begun.elapsed();
    assert!(took < limit + GRACE, "{took:?}");
}
