//! Files of scanners, of meshes and of machines, by whoever wrote them. The first byte says which:
//! the others are the file. Held against what a reader may rely on:
//!
//! * no panic, and no memory on a header's word (the fuzzer's own limit);
//! * a point that is handed out has numbers, or the reader has counted it as none;
//! * a capture gives the same profiles, their intensities too, and the same error, in whatever pieces it comes.

use std::io::{BufReader, Cursor, Read};

use umi_kinematics::AxisChain;
use umi_scan::format::clouds::cloud_from_bytes;
use umi_scan::format::poses;
use umi_scan::format::profiles::{Depth, csv, gocator, three_lines};
use umi_scan::format::table::TableReader;
use umi_scan::format::triggers;
use umi_scan::plan::mesh::part_from_bytes;
use umi_scan::plan::spec::ScanSpec;
use umi_scan::surface::stl_from_bytes;

/// A file that comes a few bytes at a time.
struct Pieces<'a>(&'a [u8], usize);

impl Read for Pieces<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        // 1 to 7 bytes, as the line would have them.
        self.1 = self.1 % 7 + 1;
        let most = self.1.min(buffer.len());
        self.0.read(&mut buffer[..most])
    }
}

/// The profiles of a capture, and how it ended.
fn profiles(capture: impl Read) -> (Vec<String>, Option<String>) {
    let mut found = Vec::new();
    let end = gocator::visit(capture, "fuzz", Depth::Intensities, |profile| {
        let bright = profile.intensities.map(<[f64]>::len);
        assert!(bright.is_none_or(|bright| bright == profile.samples.len()));
        found.push(format!("{profile:?}"));
        Ok(())
    });
    (found, end.err().map(|error| error.to_string()))
}

/// One input.
pub fn one(data: &[u8]) {
    let Some((kind, file)) = data.split_first() else {
        return;
    };
    let text = || std::str::from_utf8(file);
    match kind % 12 {
        0 => {
            if let Ok(cloud) = cloud_from_bytes(file) {
                let mut numbers = cloud.points.iter().flat_map(|point| point.iter());
                assert!(numbers.all(|mm| mm.is_finite()));
            }
        }
        1 => drop(stl_from_bytes(file)),
        2 => assert_eq!(profiles(file), profiles(Pieces(file, 0))),
        3 => {
            if let Ok(table) = TableReader::new(Cursor::new(file), "fuzz".into()) {
                let _ = csv::visit(table, Depth::Intensities, |_| Ok(()));
            }
        }
        4 => {
            if let Ok(table) = TableReader::new(BufReader::new(file), "fuzz".into()) {
                let _ = triggers::parse(table, None);
            }
        }
        5 => drop(text().map(AxisChain::parse)),
        6 => drop(text().map(|text| ScanSpec::read(text, "".as_ref()))),
        7 => drop(part_from_bytes("obj", file)),
        8 => drop(part_from_bytes("ply", file)),
        9 => drop(three_lines::visit(file, "fuzz", |profile| {
            let mut mm = profile.samples.iter().flat_map(|s| [s.x_mm, s.z_mm]);
            assert!(mm.all(f64::is_finite));
            Ok(())
        })),
        10 => {
            if let Ok(table) = TableReader::new(Cursor::new(file), "fuzz".into()) {
                let _ = poses::read(table);
            }
        }
        _ => {
            if let Ok(part) = part_from_bytes("step", file) {
                let mut mm = part.vertices.iter().flat_map(|at| at.iter());
                assert!(mm.all(|mm| mm.is_finite()));
            }
        }
    }
}
