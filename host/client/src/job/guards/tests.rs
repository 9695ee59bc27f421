//! Each row of the table, by jobs whose figures are known.

use super::{GuardTable, SeenFrom};
use umi_protocol::job::{Dialect, Job};
use umi_protocol::pattern::Coding;

fn job(text: &str) -> Job {
    toml::from_str(text).unwrap()
}

fn seen(job: &Job, code: &str) -> SeenFrom {
    let table = GuardTable::of(job);
    let row = table.rows.iter().find(|row| row.code == code);
    row.unwrap_or_else(|| panic!("no {code}")).seen
}

fn um(of: SeenFrom) -> f64 {
    match of {
        SeenFrom::Size(um) => um,
        other => panic!("{other:?}"),
    }
}

const FOUR: &str = include_str!("../../../../../examples/four-spheres.toml");
const THREE: &str = include_str!("../../../../../examples/three-spheres.toml");

/// One closing ball less.
fn without_last(job: &mut Job) {
    let last = job.guards.closing.pop().unwrap();
    job.features.retain(|feature| feature.name != last.feature);
}

/// Three standard deviations of so many balls against as many, of 1 µm a hit.
fn scatter_um(balls: f64) -> f64 {
    3.0 * (2.0 * balls).sqrt()
}

/// Four balls on a square: one that is off by d out of their plane leaves residuals of
/// d/4 each, so the registration's rms is d/4, and the limit 4.5 µm is met at 18 µm.
#[test]
fn a_fourth_ball_sees_a_chip() {
    let mut four = job(FOUR);
    for feature in &mut four.features {
        // On a circle.
        feature.position_mm = None;
    }
    four.guards.warmth = None;
    four.limits.tilt_deg = 1.0;
    four.limits.expected_error_mm = None;
    four.limits.registration_rms_mm = 0.0045;
    // The first ball is seen by the closing one, the others by their residuals.
    let from = um(seen(&four, "chip_on_top")) - scatter_um(4.0);
    assert!((from - 18.0).abs() < 0.1, "{from}");
    // With four balls the rms is that of the limit, with three there is none.
    four.limits.registration_rms_mm *= 2.0;
    let wider = um(seen(&four, "chip_on_top")) - scatter_um(4.0);
    assert!((wider - 36.0).abs() < 0.2, "{wider}");
    // Touched twice, a top that was early once is seen at the limit of the two.
    let once = um(seen(&four, "early_top")) - scatter_um(1.0);
    assert!((once - 9.0).abs() < 1e-9, "{once}");
    four.again = None;
    assert_eq!(seen(&four, "early_top"), seen(&four, "chip_on_top"));
    let mut three = job(THREE);
    for feature in &mut three.features {
        feature.position_mm = None;
    }
    three.limits.tilt_deg = 1.0;
    three.limits.rotation_deg = 360.0;
    let blind = seen(&three, "early_top");
    // Their distances see it, nine times as late.
    assert!(um(blind) > 9.0 * from, "{blind:?}");
}

/// Three balls show a chip by the tilt alone, and the part's own one makes up for as much
/// as the limit: twice its arm, of the ball that is farthest from the other two.
#[test]
fn the_parts_own_tilt_hides_a_chip() {
    let mut three = job(THREE);
    // At right angles and level, so that nothing else shows it.
    for (feature, at) in
        three
            .features
            .iter_mut()
            .zip([[0.0; 3], [200.0, 0.0, 0.0], [0.0, 300.0, 0.0]])
    {
        feature.position_mm = Some(at);
    }
    three.limits.shift_mm[2] = 1.0;
    let from = um(seen(&three, "chip_on_top")) - scatter_um(3.0);
    let both_ways = 2.0 * 300_000.0 * three.limits.tilt_deg.to_radians().tan();
    assert!((from - both_ways).abs() < 0.5, "{from} {both_ways}");
}

/// Each guard is what sees its row: without it the row is seen later or never.
#[test]
fn each_guard_sees_its_row() {
    let four = job(FOUR);
    type Without = fn(&mut Job);
    let guards: [(&str, Without); 10] = [
        ("late_text", |job| job.guards.run_variable = None),
        ("stale_read", |job| job.guards.run_variable = None),
        ("mixed_setups", |job| job.guards.run_variable = None),
        ("offset_changed", |job| job.guards.frame = false),
        ("shift_active", |job| job.guards.frame = false),
        ("shift_while_probed", |job| job.guards.frame = false),
        ("silent_teaching", |job| job.teach = Default::default()),
        ("tool_length", |job| job.guards.frame = false),
        ("not_enclosed", |job| job.guards.closing.clear()),
        ("order", |_| ()),
    ];
    for (code, without) in guards {
        assert_eq!(seen(&four, code), SeenFrom::Always, "{code}");
        let mut less = four.clone();
        without(&mut less);
        let expected = code == "order";
        assert_eq!(seen(&less, code) == SeenFrom::Always, expected, "{code}");
    }
    // Nothing was taught whose length could be compared.
    let mut given = four.clone();
    given.reference = umi_protocol::job::Reference::Given;
    assert_ne!(seen(&given, "tool_length"), SeenFrom::Always);
    assert_eq!(seen(&four, "feed"), SeenFrom::Always);
    assert_eq!(seen(&given, "feed"), seen(&four, "trips_later"));
    // By a check value; parity sees 25 of the 45 pairs of digits.
    let mut bare = four.clone();
    bare.line.data_bits = Some(8);
    bare.receiver.coding = Coding::Ascii;
    assert_eq!(seen(&bare, "digit_to_control"), SeenFrom::Never);
    let mut even = bare.clone();
    even.line.data_bits = Some(7);
    assert_eq!(seen(&even, "digit_to_control"), SeenFrom::Never);
    for (dialect, expected) in [
        (Dialect::HaasVariables, SeenFrom::Always),
        (Dialect::Variables, SeenFrom::Always),
        (Dialect::LinuxCnc, SeenFrom::Always),
        (Dialect::G68ThreeD, SeenFrom::Never),
    ] {
        bare.correction.as_mut().unwrap().dialect = dialect;
        assert_eq!(seen(&bare, "digit_to_control"), expected, "{dialect:?}");
    }
    given.guards.tool_length_mm = Some(81.5);
    assert_eq!(seen(&given, "tool_length"), SeenFrom::Always);
    // What is probed twice on the table says nothing of the part.
    let mut table = four.clone();
    without_last(&mut table);
    without_last(&mut table);
    table
        .guards
        .fixed
        .push("SPHERE1".try_into().unwrap())
        .unwrap();
    assert_ne!(seen(&table, "not_enclosed"), SeenFrom::Always);
    assert!(
        um(seen(&table, "slip")) > 20.0,
        "{:?}",
        seen(&table, "slip")
    );
    // Without runs a correction that nobody has read waits for as long as it may.
    let mut three = job(THREE);
    assert_eq!(seen(&three, "stale_read"), SeenFrom::After(1800));
    three.plate_timeout_s = 90;
    assert_eq!(seen(&three, "stale_read"), SeenFrom::After(90));
    // Macros that print blocks do not look again.
    let announced = job(include_str!(
        "../../../../../examples/three-spheres-run.toml"
    ));
    assert_eq!(seen(&announced, "shift_active"), SeenFrom::Always);
    assert_ne!(seen(&announced, "shift_while_probed"), SeenFrom::Always);
    // The closing ball sees what moves: at its limit, whatever the direction.
    for code in ["drift", "slip"] {
        let from = um(seen(&four, code));
        let mut within_um = four.guards.closing[0].within_mm * 1e3;
        if code == "drift" {
            // The last one stands against the second of seven.
            within_um *= 6.0 / 5.0;
        }
        let from = from - scatter_um(1.0);
        assert!((from - within_um).abs() < 0.01, "{code}: {from}");
        let mut open = four.clone();
        open.guards.closing.clear();
        assert!(um(seen(&open, code)) > 1.5 * from, "{code}");
    }
    // A ball on the table sees a longer probe; without it only the limit of the shift does.
    let longer = um(seen(&four, "longer_probe"));
    assert!(
        (longer - 2.0 * 60_000.0 * 2_f64.sqrt()).abs() < 1_000.0,
        "{longer}"
    );
    let mut table = four.clone();
    let mut ball = table.features[3].clone();
    ball.name = "TABLE".try_into().unwrap();
    ball.id = Some(8);
    table.features.push(ball).unwrap();
    table
        .guards
        .fixed
        .push("TABLE".try_into().unwrap())
        .unwrap();
    table.guards.fixed_mm = Some(0.006);
    umi_core::job::check(&table).unwrap();
    let from = um(seen(&table, "longer_probe")) - scatter_um(1.0);
    assert!((from - 6.0).abs() < 0.01, "{from}");
}

/// One closing ball shows no turn about it, two no rocking over both, three show each from a
/// few times their limit on.
#[test]
fn three_closing_balls_show_each_turn() {
    let mut job = job(FOUR);
    let [turned, rocked] = ["turned", "rocked"].map(|code| um(seen(&job, code)));
    let within_um = job.guards.closing[0].within_mm * 1e3;
    assert!((within_um..2.0 * within_um).contains(&turned), "{turned}");
    // By the plane of three limits a fourth ball moves by three of them.
    assert!((within_um..4.0 * within_um).contains(&rocked), "{rocked}");
    // Between the closing ones it is seen by the last alone: not about that one.
    assert_eq!(seen(&job, "moved_while_closing"), SeenFrom::Never);
    without_last(&mut job);
    assert!(um(seen(&job, "turned")) < 3.0 * within_um);
    assert_eq!(seen(&job, "rocked"), SeenFrom::Never);
    without_last(&mut job);
    assert_eq!(seen(&job, "turned"), SeenFrom::Never);
    assert_eq!(seen(&job, "rocked"), SeenFrom::Never);
}

/// One ring has nothing that it turns against.
#[test]
fn a_feature_alone_shows_no_turn() {
    let ring = job(include_str!("../../../../../examples/ring-gauge.toml"));
    for code in ["turned", "rocked"] {
        assert_eq!(seen(&ring, code), SeenFrom::Never, "{code}");
    }
}

/// Two chips on one side look like a tilt: the limit both ways, where the part leans against
/// them, over the distance of the two sides.
#[test]
fn chips_on_one_side_are_a_tilt() {
    let mut job = job(FOUR);
    let from = um(seen(&job, "chips_on_two")) - scatter_um(4.0);
    let both_ways = 2.0 * 273_000.0 * job.limits.tilt_deg.to_radians().tan();
    assert!((from - both_ways).abs() < 2.0, "{from} {both_ways}");
    job.limits.tilt_deg *= 2.0;
    // The rms would show two that are so high.
    job.limits.registration_rms_mm *= 2.0;
    let wider = um(seen(&job, "chips_on_two")) - scatter_um(4.0);
    assert!((wider / from - 2.0).abs() < 0.1, "{wider} {from}");
}

/// A worn stylus: the rms of 6 hits is that of two degrees of freedom, so a ball passes a
/// limit L with `1 - exp(-3 L²/s²)`, and of four balls one in a thousand passes where that is
/// the fourth root of it.
#[test]
fn scatter_is_seen_by_the_rms() {
    let mut four = job(FOUR);
    four.guards.learned = None;
    let from = um(seen(&four, "worn_stylus"));
    let ball = 0.001_f64.powf(0.25);
    let expected = 10.0 * (3.0 / -(1.0 - ball).ln()).sqrt();
    assert!((from - expected).abs() < 0.01, "{from} {expected}");
    for feature in &mut four.features {
        feature.hits = 4;
    }
    assert_eq!(seen(&four, "worn_stylus"), SeenFrom::Never);
}

/// A control's step is seen where touches enough stand apart.
#[test]
fn a_coarse_step_needs_touches() {
    let four = job(FOUR);
    assert_eq!(seen(&four, "coarse_step"), SeenFrom::Always);
    assert_eq!(seen(&job(THREE), "coarse_step"), SeenFrom::Always);
    // One touch of each ball's top.
    let mut tops = four;
    for feature in &mut tops.features {
        feature.approach.truncate(1);
    }
    assert_eq!(seen(&tops, "coarse_step"), SeenFrom::Never);
}

/// Dust that is alike on all tops is a part that stands higher: the limit of Z's shift and the
/// part's own shift the other way meet it, and a ball on the table says nothing of it.
#[test]
fn dust_is_a_part_that_stands_higher() {
    let job = job(FOUR);
    let from = um(seen(&job, "dust_on_tops")) - scatter_um(1.0);
    assert!((from - 200.0).abs() < 1.0, "{from}");
    let mut table = job.clone();
    let mut ball = table.features[0].clone();
    (ball.name, ball.id) = ("TABLE".try_into().unwrap(), Some(8));
    table.guards.fixed.push(ball.name.clone()).unwrap();
    table.guards.fixed_mm = Some(0.007);
    table.features.push(ball).unwrap();
    let with_table = um(seen(&table, "dust_on_tops")) - scatter_um(1.0);
    assert!((with_table - from).abs() < 1.0, "{with_table}");
    assert!(um(seen(&table, "longer_probe")) < 20.0);
}

/// A ball that has moved on its plate is there again when it is probed again: the closing ones
/// do not see it, the other balls do, and two balls do not say which way.
#[test]
fn a_ball_that_moved_is_seen_by_the_others() {
    let mut four = job(FOUR);
    let from = um(seen(&four, "ball_moved"));
    assert!((10.0..40.0).contains(&from), "{from}");
    // It stands higher as a chip does, at least.
    assert!(from >= um(seen(&four, "chip_on_top")) - 0.1, "{from}");
    four.guards.closing.clear();
    four.features.truncate(4);
    let without_closing = um(seen(&four, "ball_moved"));
    assert!((without_closing - from).abs() < 0.1, "{without_closing}");
    let three = um(seen(&job(THREE), "ball_moved"));
    assert!(three > 50.0, "{three}");
}

/// What a job leaves out and would see, the table names: each guard that is off makes a row worse,
/// and that row says its name. The first job to begin with has all that need nothing but the plate.
#[test]
fn a_guard_that_is_off_is_named() {
    let four = job(FOUR);
    type Without = fn(&mut Job);
    let guards: [(&str, &str, Without); 6] = [
        ("late_text", "run_variable", |job| {
            job.guards.run_variable = None;
        }),
        ("offset_changed", "frame", |job| job.guards.frame = false),
        ("early_top", "again", |job| job.again = None),
        ("slip", "closing", |job| job.guards.closing.clear()),
        ("worn_stylus", "learned", |job| job.guards.learned = None),
        ("trips_later", "learned", |job| job.guards.learned = None),
    ];
    let row = |job: &Job, code: &str| {
        let table = GuardTable::of(job);
        let row = table.rows.into_iter().find(|row| row.code == code);
        row.unwrap_or_else(|| panic!("no {code}"))
    };
    let is_worse = |less: SeenFrom, all: SeenFrom| {
        less != all && super::seen::worst([less, all].into_iter()) == less
    };
    for (code, name, without) in guards {
        let mut less = four.clone();
        without(&mut less);
        let (less, all) = (row(&less, code), row(&four, code));
        assert!(is_worse(less.seen, all.seen), "{code}: {less:?} {all:?}");
        assert!(less.by.contains(name), "{code}: {less:?}");
    }
    // What needs more than the plate is off, and named.
    for (code, name) in [("longer_probe", "fixed"), ("z_scale", "fixed, witness")] {
        let open = row(&four, code);
        assert!(um(open.seen) > 100.0 && open.by.contains(name), "{open:?}");
    }
}
