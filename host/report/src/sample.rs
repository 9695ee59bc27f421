//! Sessions to try the report on: the reference session through the real job,
//! clean and spoilt.

use umi_core::dprnt::{BlockEnd, Doubts, ReportedHit};
use umi_core::job::{Decision, Run};
use umi_core::units::{Micros, Point};
use umi_protocol::fault::{BlockEndCause, Fault, FaultKind};
use umi_protocol::job::{
    Approach, Compensation, CorrectionSpec, Dialect, FeatureKind, FeatureSpec, Guards, Job, Limits,
    ProgramEnd, Reference, SendWhen, Teach, WorkOffset,
};
use umi_protocol::message::Identity;
use umi_protocol::pattern::ReceiverConfig;

use umi_client::session::{Fact, Session, Setup, Truth};

/// A block as printed: name and points.
pub type Block = (String, Vec<[f64; 3]>);

/// Three spheres, taught.
pub fn job() -> Job {
    use Approach::{MinusX, MinusY, MinusZ, PlusX, PlusY};
    let sphere = |number: usize| FeatureSpec {
        name: format!("SPHERE{number}").as_str().try_into().unwrap(),
        id: None,
        kind: FeatureKind::Sphere,
        hits: 5,
        position_mm: None,
        radius_mm: Some(12.7),
        approach: [MinusZ, MinusX, PlusX, MinusY, PlusY].into_iter().collect(),
        datum: true,
    };
    Job {
        name: "THREE SPHERES".try_into().unwrap(),
        reference: Reference::Taught,
        plate_timeout_s: 1800,
        receiver: ReceiverConfig::default(),
        features: (1..=3).map(sphere).collect(),
        compensation: Compensation::InMacro,
        limits: Limits {
            radius_error_mm: 0.03,
            rms_mm: 0.015,
            approach_deg: Some(0.2),
            lone_hit_mm: Some(0.05),
            distance_error_mm: 0.01,
            registration_rms_mm: 0.005,
            rotation_deg: 3.0,
            tilt_deg: 0.015,
            shift_mm: [60.0, 60.0, 0.06],
            expected_error_mm: Some(0.01),
        },
        correction: Some(CorrectionSpec {
            dialect: Dialect::G10G68,
            probed_in: WorkOffset::G54,
            probed_origin_mm: [0.0; 3],
            write_to: WorkOffset::G55,
            set: None,
            program_number: 9010,
            ends_with: ProgramEnd::M99,
            part_min_mm: [-26.0, -36.0, 0.0],
            part_max_mm: [26.0, 36.0, 26.0],
            leftover_mm: 0.02,
            send: SendWhen::OnRequest,
        }),
        witness: None,
        teach: Teach::FirstOk,
        guards: Guards::default(),
        line: umi_protocol::serial::LineSpec::default(),
        skip: umi_protocol::job::SkipSpec::default(),
        again: None,
    }
}

fn json() -> serde_json::Value {
    serde_json::from_str(include_str!(
        "../../../tests/reference/sessions/session_a.json"
    ))
    .unwrap()
}

fn vector(value: &serde_json::Value) -> [f64; 3] {
    std::array::from_fn(|i| value[i].as_f64().unwrap())
}

/// The blocks of the reference session.
pub fn blocks() -> Vec<Block> {
    let block = |b: &serde_json::Value| {
        let points = b["points"].as_array().unwrap().iter().map(vector).collect();
        (b["name"].as_str().unwrap().to_string(), points)
    };
    json()["blocks"]
        .as_array()
        .unwrap()
        .iter()
        .map(block)
        .collect()
}

/// A session from blocks, through the real job.
pub fn session(job: Job, blocks: &[Block]) -> Session {
    let mut run = Run::new(job.clone());
    let (mut features, mut setups) = (Vec::new(), Vec::new());
    let mut take = |decision: Decision<'_>| match decision {
        Decision::Feature(feature) => features.push(feature.clone()),
        Decision::Verdict(verdict) => setups.push(Setup {
            title: String::new(),
            about: String::new(),
            features: std::mem::take(&mut features),
            verdict: verdict.clone(),
            truth: None,
        }),
        Decision::Taught(_) => {}
    };
    let now = Micros(1);
    for (name, points) in blocks {
        run.block_start(name, now, &mut take);
        for point in points {
            run.hit(&hit(*point), now, &mut take);
        }
        let got = u16::try_from(points.len()).unwrap();
        let end = BlockEnd {
            name: name.as_str().try_into().unwrap(),
            expected: Some(got),
            got,
            damaged: 0,
            complete: true,
            ended_by: BlockEndCause::Count,
        };
        run.block_end(&end, now, &mut take);
    }
    run.input_ended(&mut take);
    Session {
        title: "Five clampings of a three-sphere plate".into(),
        about: String::new(),
        job,
        identity: Some(Identity {
            board: "virtual".try_into().unwrap(),
            serial: "VIRT-0001".try_into().unwrap(),
            firmware: "0.1.0".try_into().unwrap(),
        }),
        facts: Vec::new(),
        taught_mm: None,
        path_points_mm: Vec::new(),
        setups,
        faults: Vec::new(),
    }
}

/// Names, true poses and path points of the reference session.
fn with_answers(mut session: Session) -> Session {
    let answers = json();
    for setup in &mut session.setups {
        let place = usize::try_from(setup.verdict.setup).unwrap();
        let pose = &answers["truth"]["poses"][place];
        setup.title = format!("Case {place}");
        setup.about = format!(
            "turned {}\u{b0}, shifted {} mm in X",
            pose["rotation_deg"], pose["shift_x"]
        );
        setup.truth = Some(Truth {
            rotation: std::array::from_fn(|i| vector(&pose["R"][i])),
            translation_mm: vector(&pose["t"]),
        });
    }
    let path = answers["path_points"].as_array().unwrap();
    session.path_points_mm = path.iter().map(vector).collect();
    session.about = "Probe text of the reference session through a virtual board.".into();
    session.facts.push(Fact {
        label: "Input".into(),
        value: "session_a.txt".into(),
    });
    session
}

/// The clean session: five clampings, all OK.
pub fn good() -> Session {
    with_answers(session(job(), &blocks()))
}

/// Spoilt: a null point, a wrong Z hit, a lost block, a datum 0.18 mm off.
pub fn spoilt() -> Session {
    let mut blocks = blocks();
    blocks[4].1[2] = [0.0; 3];
    blocks[6].1[0][2] += 0.2;
    blocks[7].1[3][1] *= -1.0;
    for (_, points) in &mut blocks[12..15] {
        for point in points {
            point[2] += 0.18;
        }
    }
    blocks.remove(10);
    let mut session = with_answers(session(job(), &blocks));
    session.title = "A session with damage".into();
    session.faults = vec![Fault {
        kind: FaultKind::NullPoint,
        line: 33,
        byte_offset: 612,
        t_us: 1_204_000,
        text: "* 0.0000* 0.0000* 0.0000".try_into().unwrap(),
    }];
    session
}

/// Other geometries, many hits, and the sphere of the thesis' table 4.1.
pub fn mixed() -> Session {
    use FeatureKind::{Circle, Cone, Cylinder, Plane, Sphere};
    let fits = [
        (
            "TABLE41",
            Sphere,
            Some(12.7),
            include_str!("../../../tests/reference/fits/sphere_thesis_table_4_1.csv"),
        ),
        (
            "CAP",
            Sphere,
            None,
            include_str!("../../../tests/reference/fits/sphere_cap120_n25_1um.csv"),
        ),
        (
            "TOP",
            Plane,
            None,
            include_str!("../../../tests/reference/fits/plane_n9_16um.csv"),
        ),
        (
            "RING",
            Circle,
            None,
            include_str!("../../../tests/reference/fits/circle_ring_gauge_36.csv"),
        ),
        (
            "BORE",
            Cylinder,
            None,
            include_str!("../../../tests/reference/fits/cylinder_rings2x4_1um.csv"),
        ),
        (
            "CONE",
            Cone,
            None,
            include_str!("../../../tests/reference/fits/cone_half30_n24_1um.csv"),
        ),
    ];
    let mut job = job();
    job.name = "MIXED".try_into().unwrap();
    job.correction = None;
    let template = job.features[0].clone();
    job.features.clear();
    let mut blocks = Vec::new();
    for (name, kind, radius_mm, csv) in fits {
        let row = |line: &str| {
            let mut cells = line.split(',').map(|cell| cell.parse::<f64>().unwrap());
            std::array::from_fn(|_| cells.next().unwrap())
        };
        let points: Vec<[f64; 3]> = csv.lines().skip(1).map(row).collect();
        let mut spec = template.clone();
        spec.name = name.try_into().unwrap();
        spec.kind = kind;
        spec.hits = u16::try_from(points.len()).unwrap();
        spec.radius_mm = radius_mm;
        spec.approach.clear();
        spec.datum = false;
        job.features.push(spec).unwrap();
        blocks.push((name.to_string(), points));
    }
    let mut session = session(job, &blocks);
    session.title = "Other geometries".into();
    session
}

fn hit(point: [f64; 3]) -> ReportedHit {
    ReportedHit {
        line: 0,
        first: Micros(0),
        last: Micros(0),
        position: Point::from_array_mm(point),
        digits: [None; 3],
        feature: None,
        feature_id: None,
        index: None,
        run: None,
        sequence: None,
        approach: None,
        touched: None,
        feed_mm_per_min: None,
        doubts: if point == [0.0; 3] {
            Doubts::NULL_POINT
        } else {
            Doubts::NONE
        },
    }
}

// --- reading pictures back

/// The text after `from`, up to `to`.
pub fn between<'a>(text: &'a str, from: &str, to: &str) -> &'a str {
    let rest = &text[text.find(from).unwrap() + from.len()..];
    &rest[..rest.find(to).unwrap()]
}

/// Ends of the nth line of a class.
pub fn line_ends(svg: &str, class: &str, nth: usize) -> [[f64; 2]; 2] {
    let line = svg
        .split("<line ")
        .filter(|l| l.starts_with(class))
        .nth(nth)
        .unwrap_or_else(|| panic!("no {class}"));
    let value = |name: &str| between(line, &format!("{name}=\""), "\"").parse().unwrap();
    [[value("x1"), value("y1")], [value("x2"), value("y2")]]
}

/// Length of the nth line of a class.
pub fn line_length(svg: &str, class: &str, nth: usize) -> f64 {
    let [a, b] = line_ends(svg, class, nth);
    (a[0] - b[0]).hypot(a[1] - b[1])
}
