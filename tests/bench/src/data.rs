//! The data that all contenders work on.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result};
use umi_core::units::Point;
use umi_figures::half_sphere;

/// Points of the tasks, and the text of a probing session.
pub struct Data {
    /// What a control prints: fifteen spheres of five hits, blanks for asterisks, CR LF.
    pub session: Vec<u8>,
    /// Five hits on a sphere, as a part program probes it.
    pub sphere_5: Vec<[f64; 3]>,
    /// Half a sphere, densely probed or scanned.
    pub sphere_500: Vec<[f64; 3]>,
    /// Three sphere centres before and after the setup has moved.
    pub pairs_3: Vec<[f64; 6]>,
    /// Fifty pairs far from the origin.
    pub pairs_50: Vec<[f64; 6]>,
    /// Readings of a point sensor on a ball: axes and distance, a spiral of a hundred places.
    pub readings: Vec<[f64; 4]>,
    /// That ball: centre and radius.
    pub ball: [f64; 4],
    /// A finishing path, about 1 MB.
    pub path: String,
}

impl Data {
    /// Reads the reference data of the project, and makes what it does not have.
    pub fn load() -> Result<Self> {
        let session = reference().join("sessions/session_b.txt");
        Ok(Self {
            session: std::fs::read(&session)
                .with_context(|| format!("cannot read {}", session.display()))?,
            readings: read("point/paper_spiral_1um.csv")?,
            ball: ball("point/paper_spiral_1um.spheres.toml")?,
            sphere_5: read("fits/sphere_thesis_table_4_1.csv")?,
            sphere_500: half_sphere(500, 1).map(Point::to_array_mm).collect(),
            pairs_3: read("fits/registration_thesis_table_4_2_case1.csv")?,
            pairs_50: read("fits/registration_far_n50_0p1mm.csv")?,
            path: laces(0, 6000),
        })
    }

    /// Writes every set into a folder, with the digits that give back the same numbers.
    pub fn write(&self, folder: &Path) -> Result<()> {
        std::fs::create_dir_all(folder)?;
        std::fs::write(folder.join("session.txt"), &self.session)?;
        write(folder, "sphere-5", &self.sphere_5)?;
        write(folder, "sphere-500", &self.sphere_500)?;
        write(folder, "pairs-3", &self.pairs_3)?;
        write(folder, "pairs-50", &self.pairs_50)?;
        write(folder, "readings-100", &self.readings)?;
        write(folder, "ball", &[self.ball])
    }
}

/// Laces of a finishing path as CAM software writes them (the style of Sawula 2013, appendix
/// E): an arc of 109 mm radius in lines along X; every block names all axes.
pub fn laces(first: u32, count: u32) -> String {
    let mut text = String::new();
    if first == 0 {
        text.push_str("G21 G90\nG0 X0.0 Y0.0 Z100.0\n");
    }
    for lace in first..first + count {
        let y = 35.004 - 70.0 * f64::from(lace % 28_000) / 28_000.0;
        let z = (109.0_f64.powi(2) - y * y).sqrt() - 109.0 + 24.265;
        let above = z + 5.0;
        // Writing to a String cannot fail.
        let _ = write!(
            text,
            "N{n}0 G0 X-25.399 Y{y:.3} Z50.0\nN{n}1 G0 X-25.399 Y{y:.3} Z{above:.3}\n\
             N{n}2 G1 X-25.399 Y{y:.3} Z{z:.3} F1000.0\nN{n}3 G1 X25.391 Y{y:.3} Z{z:.3}\n\
             N{n}4 G0 X25.391 Y{y:.3} Z50.0\n",
            n = lace % 10_000
        );
    }
    text
}

fn reference() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../reference")
}

fn read<const N: usize>(name: &str) -> Result<Vec<[f64; N]>> {
    let path = reference().join(name);
    let text = std::fs::read_to_string(&path)
        .with_context(|| format!("cannot read {}", path.display()))?;
    text.lines()
        .skip(1)
        .map(|line| {
            let values: Result<Vec<f64>, _> = line.split(',').map(str::parse).collect();
            let row = values.ok().and_then(|values| values.try_into().ok());
            row.with_context(|| format!("{name}: `{line}` is not {N} numbers"))
        })
        .collect()
}

/// Centre and radius of the one ball of a file.
fn ball(name: &str) -> Result<[f64; 4]> {
    let path = reference().join(name);
    let text = std::fs::read_to_string(&path)
        .with_context(|| format!("cannot read {}", path.display()))?;
    let values: Vec<f64> = text
        .lines()
        .filter(|line| line.starts_with("center_mm") || line.starts_with("radius_mm"))
        .flat_map(|line| line.split(['=', '[', ']', ',']))
        .filter_map(|word| word.trim().parse().ok())
        .collect();
    let ball = values.try_into().ok();
    ball.with_context(|| format!("{name}: no centre and radius"))
}

fn write<const N: usize>(folder: &Path, name: &str, rows: &[[f64; N]]) -> Result<()> {
    let mut text = String::new();
    for row in rows {
        let row: Vec<String> = row.iter().map(f64::to_string).collect();
        writeln!(text, "{}", row.join(","))?;
    }
    Ok(std::fs::write(folder.join(format!("{name}.csv")), text)?)
}
