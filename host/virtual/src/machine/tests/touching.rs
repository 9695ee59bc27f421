//! Contact, trigger, release and what must not touch.

use nalgebra::Vector3;
use umi_core::units::Rad;

use super::*;

fn scene(text: &str) -> VirtualMachine<Log> {
    VirtualMachine::new(Scene::parse(text).unwrap(), 5, Log::default())
}

const BALL: &str = "
    [[body]]
    name = 'BALL'
    shape = { sphere = { radius_mm = 12.7 } }
    position_mm = [1.0, 2.0, 3.0]
";

/// The probe triggers where the ball has pushed the tip by the pretravel along its
/// normal, off centre as well: the centres are then the radii less the pretravel apart.
#[test]
fn oblique_trigger_is_exact() {
    for y in [0.0, 5.0, 10.0, 14.0] {
        let mut m = scene(&format!(
            "[machine]\nstart_mm = [40.0, {y}, 3.0]\n\
             [probe]\npretravel_mm = 0.05\naxial_pretravel_mm = 0.05\n{BALL}"
        ));
        skip(&mut m, [-40.0, y, 3.0], 60.0);
        let hit = &m.hits()[0];
        let center = Vector3::new(1.0, 2.0, 3.0);
        assert!(((hit.contact.mm - center).norm() - 15.2).abs() < 1e-9);
        assert!(((hit.latched.mm - center).norm() - 15.15).abs() < 1e-9);
    }
    // A grazing touch that pushes by less than the pretravel stays unseen.
    let mut m = scene(&format!(
        "[machine]\nstart_mm = [40.0, 17.16, 3.0]\n[probe]\npretravel_mm = 0.05\n{BALL}"
    ));
    assert!(!skip(&mut m, [-40.0, 17.16, 3.0], 60.0).touched);
    assert!(m.hits().is_empty() && m.wires.skips.is_empty());
}

/// Leaving (G38.4) stores where the stylus is bent by less than the pretravel again; no
/// rising edge comes of it.
#[test]
fn leaving_is_exact() {
    let mut m = machine("[probe]\npretravel_mm = 0.1", 1);
    skip(&mut m, [30.0, 0.0, 50.0], 600.0);
    let away = line([5.0, 0.0, 50.0], MotionRate::Feed(60.0));
    let left = m.skip(&away, true).unwrap();
    assert!(left.touched);
    assert!((left.stored.mm.x - 17.6).abs() < 1e-8, "{left:?}");
    assert_eq!(m.wires.skips.len(), 1);
    assert!(skip(&mut m, [30.0, 0.0, 50.0], 60.0).touched);
    assert_eq!(m.wires.skips.len(), 2);
}

/// A stylus may back off along an arc, whose first chord alone does not free it; moving
/// on into the body is refused, and so is a second touch on the way.
#[test]
fn backing_off_on_an_arc() {
    let half_turn = |sign: f64| AxisMotion {
        to: Point::from_mm(0.0, 0.0, 50.0),
        path: MotionPath::Arc {
            center: Point::from_mm(0.0, 0.0, 50.0),
            axis: Vector3::z(),
            sweep: Rad(sign),
        },
        rate: MotionRate::Feed(1000.0),
    };
    let mut m = machine("", 1);
    skip(&mut m, [30.0, 0.0, 50.0], 1000.0);
    let bent = m.position().mm.x;
    assert!(bent > 17.55);
    let mut quarter = half_turn(0.5 * core::f64::consts::PI);
    quarter.to = Point::from_mm(0.0, bent, 50.0);
    m.travel(&quarter).unwrap();

    let mut m = machine("", 1);
    skip(&mut m, [30.0, 0.0, 50.0], 1000.0);
    let trip = m
        .travel(&line([18.5, 0.0, 50.0], MotionRate::Feed(10.0)))
        .unwrap_err();
    assert!(trip.message.contains("further"), "{}", trip.message);

    let mut m = machine("", 1);
    skip(&mut m, [30.0, 0.0, 50.0], 1000.0);
    let bent = m.position().mm.x;
    let mut turn = half_turn(2.0 * core::f64::consts::PI);
    turn.to = Point::from_mm(bent, 0.0, 50.0);
    let trip = m.travel(&turn).unwrap_err();
    assert!(trip.message.contains("collision"), "{}", trip.message);
}

/// A collision leaves the axes where they were stopped, at the time it took.
#[test]
fn collision_stops_at_contact() {
    let mut m = machine("[machine]\nacceleration_mm_per_s2 = 1e12", 1);
    m.travel(&line([0.0, 0.0, 50.0], MotionRate::Rapid))
        .unwrap();
    let before = m.seconds();
    m.travel(&line([30.0, 0.0, 50.0], MotionRate::Feed(1050.0)))
        .unwrap_err();
    assert!((m.position().mm.x - 17.5).abs() < 1e-8);
    assert!((m.seconds() - before - 1.0).abs() < 1e-4);
}

/// Passing a face at a hundredth of a micrometre is no touch.
#[test]
fn passing_close_by() {
    let mut m = machine("", 1);
    m.travel(&line([17.49999, 0.0, 50.0], MotionRate::Rapid))
        .unwrap();
    m.travel(&line([17.49999, 300.0, 50.0], MotionRate::Rapid))
        .unwrap();
}

/// The stem must not touch, with skip or without: an overhang above a low target.
#[test]
fn stem_collides() {
    let text = "
        [machine]
        start_mm = [30.0, 0.0, 0.0]
        [probe]
        stem_radius_mm = 1.5
        [[body]]
        name = 'OVERHANG'
        shape = { block = { size_mm = [10.0, 10.0, 20.0] } }
        position_mm = [0.0, 0.0, 40.0]
    ";
    let mut m = scene(text);
    let to = line([0.0, 0.0, 0.0], MotionRate::Feed(100.0));
    let trip = m.skip(&to, false).unwrap_err();
    assert!(trip.message.contains("stem") && trip.message.contains("OVERHANG"));
    assert!((m.position().mm.x - 6.5).abs() < 1e-6, "{:?}", m.position());
    assert!(
        scene(text)
            .travel(&to)
            .unwrap_err()
            .message
            .contains("stem")
    );
    let bare = text.replace("stem_radius_mm = 1.5", "");
    scene(&bare).travel(&to).unwrap();
}

/// A control that stores what it has sent stores it feed over gain too far.
#[test]
fn sent_position_contains_the_lag() {
    let mut m = machine(
        "[control]\nskip_stores = 'sent'\n[machine]\nposition_gain_per_s = 25.0",
        1,
    );
    let stored = skip(&mut m, [30.0, 0.0, 50.0], 600.0).stored.mm.x;
    assert!((stored - 17.5 - 0.4).abs() < 1e-6, "{stored}");
}

/// A polled signal waits for the next look: less than the interval, never the same.
#[test]
fn polled_signal() {
    let mut m = machine("[control]\nskip_poll_ms = 8.0", 1);
    for step in 0..20 {
        let x = 5.0 + 0.013 * f64::from(step);
        m.travel(&line([x, 0.0, 50.0], MotionRate::Rapid)).unwrap();
        skip(&mut m, [30.0, 0.0, 50.0], 300.0);
    }
    let delays: Vec<f64> = m.hits().iter().map(|hit| hit.delay_ms).collect();
    assert!(
        delays.iter().all(|d| (-1e-6..8.0).contains(d)),
        "{delays:?}"
    );
    let most = delays.iter().copied().fold(f64::MIN, f64::max);
    let least = delays.iter().copied().fold(f64::MAX, f64::min);
    assert!(most - least > 4.0, "{delays:?}");
}

/// A motion that is over before the control looks ends without a touch for the program,
/// though the edge was on the wire.
#[test]
fn noticed_too_late() {
    let mut m = machine("[control]\nskip_delay_ms = [400.0, 400.0]", 1);
    let missed = skip(&mut m, [17.6, 0.0, 50.0], 300.0);
    assert!(!missed.touched);
    assert_eq!(missed.stored, Point::from_mm(17.6, 0.0, 50.0));
    assert_eq!(m.wires.skips.len(), 1);
}

/// No feed, no motion; tool 0 is taken if the magazine has one.
#[test]
fn small_refusals() {
    let mut m = machine("[tools.0]\nlength_mm = 30.0\nradius_mm = 4.0", 1);
    for feed in [0.0, -1.0, f64::NAN] {
        let trip = m
            .travel(&line([1.0, 0.0, 50.0], MotionRate::Feed(feed)))
            .unwrap_err();
        assert!(trip.message.contains("feed"), "{}", trip.message);
    }
    // The end of the tool is 30 below the gauge line, the floor at 0.
    m.change_tool(0).unwrap();
    m.travel(&line([0.0, 0.0, 29.0], MotionRate::Rapid))
        .unwrap_err();
    assert!((m.position().mm.z - 30.0).abs() < 1e-8);
}
