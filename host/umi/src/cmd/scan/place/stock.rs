//! `umi scan stock`

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use serde_json::{Value, json};
use umi_scan::ScanError;
use umi_scan::format::clouds::read_cloud;
use umi_scan::parallel::Threads;
use umi_scan::rigid::{Pose, Vec3};
use umi_scan::stock::{Objective, StockFound, StockTask};
use umi_scan::surface::read_stl;

use super::placed::Placed;
use super::transform::{self, ScanFrame};
use super::{faces, stock_page};
use crate::cmd::Format;
use crate::cmd::scan::answer::failure;
use crate::cmd::scan::triple::finite;
use crate::failure::Failure;
use crate::output::Force;
use crate::show::terminal::Plain;

/// How much stock a scanned raw part has on every face, and where the finished part lies best in it
#[derive(Args)]
#[command(after_help = HELP)]
pub(crate) struct Stock {
    /// The finished part, STL in mm
    #[arg(value_name = "MODEL.stl")]
    model: PathBuf,
    /// The scan of the raw part: PLY, PCD, LAS, STL or columns x,y,z, in mm
    #[arg(value_name = "SCAN")]
    scan: PathBuf,
    /// What is best: the least stock the largest (min), the stock the most even
    /// (balanced), or the least (least-squares)
    #[arg(long, value_enum, default_value = "min")]
    objective: Best,
    /// Directions and turns that stay as they are, of x,y,z,a,b,c
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    lock: Vec<Axis>,
    /// What the turns go through, in part coordinates
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = transform::point, default_value = "0,0,0")]
    pivot: [f64; 3],
    /// Where the part lies about (scan from part); unmoved without
    #[arg(long, value_name = "T.json")]
    start: Option<PathBuf>,
    /// The stock that every face needs
    #[arg(long, value_name = "MM", allow_hyphen_values = true, value_parser = finite)]
    require: Option<f64>,
    /// What is apart from the rest of the scan is of the raw part too, however much further off it stands
    #[arg(long)]
    apart: bool,
    /// Faces with demands of their own: `[[face]]` name, mesh, stock_mm or profile_mm
    #[arg(long, value_name = "FACES.toml")]
    faces: Option<PathBuf>,
    /// Threads; the result has the same bits for any number
    #[arg(long, value_name = "N")]
    threads: Option<usize>,
    /// Write the transform for `umi correction` and `umi nc rewrite`; by one that is NG they move
    /// nothing
    #[arg(short, long, value_name = "T.json")]
    output: Option<PathBuf>,
    #[command(flatten)]
    frame: ScanFrame,
    /// Write the scan with its stock per point as PLY
    #[arg(long, value_name = "FILE.ply")]
    map: Option<PathBuf>,
    /// Write a page with the stock: maps, sections, a histogram, the least spot
    #[arg(long, value_name = "R.html")]
    report: Option<PathBuf>,
    #[command(flatten)]
    force: Force,
    #[command(flatten)]
    pub format: Format,
}

const HELP: &str = "\
Stock is the signed distance from the finished part's surface to a scanned point;
positive is material. The transform carries part coordinates into the scan's.
Verdict OK: by any objective, every face has the stock that it needs.

Single points that no neighbour is like are left out as spikes. Where one of them has
too little stock, the verdict is NG: a pit can be that narrow. What is apart from the
rest of the scan and stands off by 2.5 times the stock of the rest and 3 % of the part's
size, as a wall behind it may, is left out, too, with a warning: it shows no face. Where
it is the raw part's own, scan what lies between, or say --apart.
What is not scanned is told (NG unmeasured, above 1 % of the part's area): a face, or any
part of one that is as large as 1 % of the area, or as 100 points of the scan cover where
it has fewer than 10 000, with less than a tenth of the points that such an area has on
average. The side of a bore or of a boss is one face all around, also of six flat sides;
bores that are smaller than that are not asked, however many they are, nor walls at right
angles that are each smaller. A hole in what was scanned is told from
1.5 times that size on if it is round; a long and narrow one can be missed.
A side that is scanned 20 times as thinly as more than half of the part counts as not scanned.
A wall or a jaw that is nearer looks as a raw face would, and counts as one: nothing in
the points tells them apart. Scan every face, and crop what is not the raw part.

Examples:
  umi scan stock part.stl raw.ply
  umi scan stock part.stl raw.ply --require 0.5 -o moved.json --scan-in offset
  umi scan stock part.stl raw.ply --lock a,b --pivot 0,0,20      turns about C only
  umi scan stock part.stl raw.ply --faces faces.toml

With --faces, each face states what it needs:
  [[face]]
  name = \"bore\"
  mesh = \"bore.stl\"      # its triangles, a part of the model
  stock_mm = 0.3         # or profile_mm = 1.2: as built, half of it to either side

Exit status: 0 verdict OK; 2 verdict NG (no_stock, too_little_stock, spike_below,
unmeasured) or refused (too_few_points, unbounded, empty_model, not_finite); 1 a file
(bad_file) or usage.";

/// What was found of which files.
struct StockAnswer {
    found: StockFound,
    /// Points in the scan.
    n: usize,
    /// Those of them without three finite coordinates: they were left out.
    not_finite: usize,
    /// What is odd about the model.
    warnings: Vec<String>,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Best {
    Min,
    Balanced,
    LeastSquares,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Axis {
    X,
    Y,
    Z,
    A,
    B,
    C,
}

const AXES: [(Axis, &str); 6] = [
    (Axis::X, "x"),
    (Axis::Y, "y"),
    (Axis::Z, "z"),
    (Axis::A, "a"),
    (Axis::B, "b"),
    (Axis::C, "c"),
];

impl Stock {
    pub fn run(self) -> Result<(), Failure> {
        let inputs: Vec<&Path> = [&self.model, &self.scan]
            .into_iter()
            .chain(&self.start)
            .chain(&self.faces)
            .map(PathBuf::as_path)
            .collect();
        let outputs = self.output.iter().chain(&self.map).chain(&self.report);
        self.force.check_each(outputs, &inputs)?;
        let answer = self.find().map_err(failure)?;
        let placed = Placed {
            motion: &answer.found.motion,
            frames: self.frame.of_part(),
            certainty: None,
            reasons: &answer.found.reasons,
        };
        placed.answer(
            self.output.as_deref(),
            self.format.json,
            || self.machine(&placed, &answer),
            || answer.text(&placed),
        )
    }

    fn find(&self) -> Result<StockAnswer, ScanError> {
        let model = read_stl(&self.model)?;
        let cloud = read_cloud(&self.scan)?;
        let demands = match &self.faces {
            Some(path) => faces::read(path)?,
            None => Vec::new(),
        };
        let start = match &self.start {
            Some(path) => transform::read(path)?,
            None => Pose::identity(),
        };
        let task = StockTask {
            model: &model,
            points: &cloud.points,
            objective: match self.objective {
                Best::Min => Objective::Min,
                Best::Balanced => Objective::Balanced,
                Best::LeastSquares => Objective::LeastSquares,
            },
            locked: AXES.map(|(axis, _)| self.lock.contains(&axis)),
            pivot: Vec3::from(self.pivot),
            start,
            require_mm: self.require,
            apart_is_raw: self.apart,
            demands: &demands,
            threads: self.threads.map_or_else(Threads::all, Threads::new),
        };
        let found = task.find()?;
        let io = |path: &Path, error: std::io::Error| ScanError::file("write", path, &error);
        let used: Vec<Vec3> = (0..cloud.points.len())
            .filter(|i| found.spikes.binary_search(i).is_err())
            .filter(|i| found.clutter.binary_search(i).is_err())
            .map(|i| cloud.points[i])
            .collect();
        if let Some(path) = &self.map {
            let file = std::fs::File::create(path).map_err(|error| io(path, error))?;
            let mut file = std::io::BufWriter::new(file);
            let stock: Vec<f64> = found.measured.iter().map(|m| m.distance_mm).collect();
            umi_scan::format::clouds::write_ply(&mut file, &used, &[("stock_mm", &stock)])
                .map_err(|error| io(path, error))?;
        }
        if let Some(path) = &self.report {
            let least_mm = self.require.unwrap_or(0.0);
            let page = stock_page::page(&self.model, &used, &found, least_mm)?;
            std::fs::write(path, page).map_err(|error| io(path, error))?;
        }
        let mut warnings = model.flaws();
        if !found.clutter.is_empty() {
            warnings.push(format!(
                "clutter: {} points were left out as other things than the raw part: they stand far off the part, and apart from \
                 the rest of the scan. Where they are of the raw part, scan what lies between, or say --apart",
                found.clutter.len()
            ));
        }
        Ok(StockAnswer {
            found,
            n: cloud.points.len() + cloud.not_finite,
            not_finite: cloud.not_finite,
            warnings,
        })
    }

    fn objective(&self) -> &'static str {
        match self.objective {
            Best::Min => "min",
            Best::Balanced => "balanced",
            Best::LeastSquares => "least-squares",
        }
    }

    fn machine(&self, placed: &Placed<'_>, answer: &StockAnswer) -> Value {
        let found = &answer.found;
        let locked: Vec<&str> = AXES
            .iter()
            .filter(|(axis, _)| self.lock.contains(axis))
            .map(|(_, name)| *name)
            .collect();
        let faces: Vec<Value> = found
            .faces
            .iter()
            .map(|face| {
                json!({"name": face.name, "n": face.points.len(), "min_mm": face.min_mm, "mean_mm": face.mean_mm,
                    "max_mm": face.max_mm, "margin_mm": face.margin_mm})
            })
            .collect();
        let fields = json!({
            "objective": self.objective(),
            "min_mm": found.min_mm, "mean_mm": found.mean_mm, "max_mm": found.max_mm,
            "margin_mm": found.margin_mm,
            "least_at_mm": found.least_at_mm.as_slice(),
            "n": answer.n, "not_finite": answer.not_finite, "n_used": found.n_used, "spikes": found.spikes,
            "clutter": found.clutter.len(),
            "locked": locked, "faces": faces, "unmeasured": found.unmeasured,
            "verdict": placed.verdict(),
            "reasons": placed.reasons(), "warnings": answer.warnings,
        });
        placed.object("stock", fields)
    }
}

impl StockAnswer {
    fn text(&self, placed: &Placed<'_>) -> String {
        let (found, n) = (&self.found, self.n);
        let mut text = placed.headline();
        for warning in &self.warnings {
            let _ = writeln!(text, "warning: {warning}");
        }
        let p = found.least_at_mm;
        let _ = writeln!(
            text,
            "stock   least {:.4} mm at {:.3}, {:.3}, {:.3}   mean {:.4}   largest {:.4}",
            Plain(found.min_mm),
            Plain(p.x),
            Plain(p.y),
            Plain(p.z),
            Plain(found.mean_mm),
            Plain(found.max_mm)
        );
        for face in &found.faces {
            let [min, mean, margin] =
                [face.min_mm, face.mean_mm, face.margin_mm].map(|mm| mm.map(Plain));
            match (min, mean, margin) {
                (Some(min), Some(mean), Some(margin)) => {
                    let _ = writeln!(
                        text,
                        "  {}: least {min:.4}   mean {mean:.4}   margin {margin:+.4} mm   {} points",
                        face.name,
                        face.points.len()
                    );
                }
                _ => {
                    let _ = writeln!(text, "  {}: no points", face.name);
                }
            }
        }
        let _ = writeln!(
            text,
            "points  {} of {n} used, {} left out as spikes, {} as other things, {} not finite; {:.1} % of the surface not scanned",
            found.n_used,
            found.spikes.len(),
            found.clutter.len(),
            self.not_finite,
            found.unmeasured * 100.0
        );
        text.push_str(&placed.pose("scan from part"));
        text
    }
}
