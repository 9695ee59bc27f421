//! Ways between passes that touch nothing.

use nalgebra::Vector3;

use super::super::machine::PlanMachine;
use super::super::spec::ScanSpec;
use super::touch::Scenery;

/// How far the sensor is drawn back, one after the other, until the way is free.
const LIFTS_MM: [f64; 7] = [5.0, 15.0, 40.0, 80.0, 150.0, 250.0, 400.0];

/// Is the way straight up from these axis values to the top of Z free?
pub fn clear_above(machine: &PlanMachine, scenery: &Scenery<'_>, axes: &[f64]) -> bool {
    let mut top = axes.to_vec();
    top[2] = machine.travel_mm[2][1].max(top[2]);
    !scenery.touches_between(machine, axes, &top)
}

/// Axis values with the sensor drawn back along its beam, or up the machine's Z; X Y Z end with their travel.
pub(super) fn raised(
    machine: &PlanMachine,
    axes: &[f64],
    lift: f64,
    straight_up: bool,
) -> Vec<f64> {
    let beam = machine.pointing(&axes[3..]).0;
    let back = if straight_up {
        Vector3::z()
    } else {
        -machine.direction_off_part(&beam, &axes[3..])
    };
    let mut raised = axes.to_vec();
    for k in 0..3 {
        let [low, high] = machine.travel_mm[k];
        raised[k] = super::axes::rounded((axes[k] + back[k] * lift).clamp(low, high));
    }
    raised
}

/// Axis values between two poses, both left out, over whatever is in the way; none where no such way was found.
pub fn link(
    spec: &ScanSpec,
    scenery: &Scenery<'_>,
    from: &[f64],
    to: &[f64],
) -> Option<Vec<Vec<f64>>> {
    let machine = &spec.machine;
    if !scenery.touches_between(machine, from, to) {
        return Some(Vec::new());
    }
    let free = |way: &[Vec<f64>]| {
        way.iter().all(|axes| machine.within_limits(axes))
            && way
                .windows(2)
                .all(|w| !scenery.touches_between(machine, &w[0], &w[1]))
    };
    for lift in LIFTS_MM {
        for straight_up in [false, true] {
            let raise = |axes: &[f64]| raised(machine, axes, lift, straight_up);
            let (up, over) = (raise(from), raise(to));
            // Turned on the spot first, or last, or on the way.
            let mut turned_first = up.clone();
            turned_first[3..].copy_from_slice(&over[3..]);
            let mut turned_last = over.clone();
            turned_last[3..].copy_from_slice(&up[3..]);
            for between in [None, Some(turned_first), Some(turned_last)] {
                let mut way = vec![from.to_vec(), up.clone()];
                way.extend(between);
                way.push(over.clone());
                way.push(to.to_vec());
                if free(&way) {
                    way.pop();
                    way.remove(0);
                    return Some(way);
                }
            }
        }
    }
    None
}
