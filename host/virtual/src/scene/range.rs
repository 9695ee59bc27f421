//! Which numbers a scene may hold.
//!
//! A number that is none (`nan`, `inf`) or far from all sense would not stop a machine
//! but blind it: a body at `nan` is touched by nothing. So every number of the text is
//! held against a table before anything is made of it.

use toml::{Table, Value};

use super::SceneError;

/// Far enough for every machine.
const FAR_MM: f64 = 1e5;

/// Name, least and largest value; `*` stands for any name. Of a list, each number is
/// meant.
const RANGES: [(&str, f64, f64); 107] = [
    ("machine.travel_min_mm", -FAR_MM, FAR_MM),
    ("machine.travel_max_mm", -FAR_MM, FAR_MM),
    ("machine.reference_mm", -FAR_MM, FAR_MM),
    ("machine.start_mm", -FAR_MM, FAR_MM),
    ("machine.rapid_mm_per_min", 1.0, 1e6),
    ("machine.acceleration_mm_per_s2", 1.0, 1e12),
    ("machine.position_gain_per_s", 0.0, 1e4),
    ("machine.counts_per_mm", -1e7, 1e7),
    ("machine.origin_counts", -1e15, 1e15),
    ("machine.index_counts", 0.0, 1e12),
    ("machine.rotary.*.axis", -1e6, 1e6),
    ("machine.rotary.*.point_mm", -FAR_MM, FAR_MM),
    ("machine.rotary.*.limits_deg", -1e5, 1e5),
    ("machine.rotary.*.start_deg", -1e5, 1e5),
    ("machine.rotary.*.counts_per_deg", -1e7, 1e7),
    ("machine.rotary.*.origin_counts", -1e15, 1e15),
    ("machine.rotary.*.deg_per_min", 1e-3, 1e6),
    ("machine.homing_error_mm", -100.0, 100.0),
    ("machine.scale_error_ppm", -1e4, 1e4),
    ("machine.position_noise_um", 0.0, 1000.0),
    ("machine.drift_mm", -10.0, 10.0),
    ("machine.drift_time_s", 1e-3, 1e9),
    ("control.skip_delay_ms", 0.0, 1000.0),
    ("control.skip_poll_ms", 0.0, 1000.0),
    ("control.baud", 50.0, 1e7),
    ("control.bits", 7.0, 13.0),
    ("control.nc.increment_mm", 1e-6, 1.0),
    ("control.nc.feed_mm_min", 1e-3, 1e6),
    ("control.nc.arc_tolerance_mm", 0.0, 10.0),
    ("control.nc.second_reference_mm", -FAR_MM, FAR_MM),
    ("control.nc.date", 0.0, 99_991_231.0),
    ("control.nc.time", 0.0, 235_959.0),
    ("control.nc.limits.blocks", 1.0, 1e12),
    ("control.nc.limits.loops", 1.0, 1e12),
    ("control.nc.limits.call_depth", 1.0, 100.0),
    ("control.nc.limits.text", 1.0, 1e9),
    ("control.nc.limits.programs", 1.0, 1e6),
    ("control.nc.limits.names", 1.0, 1e6),
    ("probe.tool", 1.0, 99_999_999.0),
    ("probe.tip_radius_mm", 1e-3, 100.0),
    ("probe.length_mm", 0.0, 1000.0),
    ("probe.stem_radius_mm", 0.0, 100.0),
    ("probe.stem_length_mm", 1e-3, 1000.0),
    ("probe.pretravel_mm", 0.0, 10.0),
    ("probe.lobing_mm", -10.0, 10.0),
    ("probe.lobing_phase_deg", -360.0, 360.0),
    ("probe.ovality_mm", -10.0, 10.0),
    ("probe.axial_pretravel_mm", 0.0, 10.0),
    ("probe.repeatability_um", 0.0, 1000.0),
    ("probe.filter_us", 0.0, 1e6),
    ("probe.overtravel_mm", 1e-3, 100.0),
    ("point_sensor.tool", 1.0, 99_999_999.0),
    ("point_sensor.offset_mm", -1000.0, 1000.0),
    ("point_sensor.direction", -1e6, 1e6),
    ("point_sensor.stand_off_mm", 1e-3, 10_000.0),
    ("point_sensor.range_mm", 1e-3, 10_000.0),
    ("point_sensor.spot_um", 0.0, 10_000.0),
    ("point_sensor.noise_um", 0.0, 10_000.0),
    ("point_sensor.linearity_percent", 0.0, 10.0),
    ("point_sensor.angle_deg", 1.0, 90.0),
    ("point_sensor.max_rate_hz", 1.0, 1e7),
    ("point_sensor.gain_error_ppm", -1e5, 1e5),
    ("point_sensor.power_max", 1e-3, 1e9),
    ("scanner.position_mm", -FAR_MM, FAR_MM),
    ("scanner.look_at_mm", -FAR_MM, FAR_MM),
    ("scanner.field_deg", 0.1, 170.0),
    ("scanner.distance_mm", 1.0, FAR_MM),
    ("scanner.spacing_mm", 1e-3, 1000.0),
    ("scanner.range_mm", 0.0, FAR_MM),
    ("scanner.noise_mm", 0.0, 100.0),
    ("scanner.shared_noise_mm", 0.0, 100.0),
    ("scanner.shared_length_mm", 1e-2, FAR_MM),
    ("scanner.grazing_deg", 1.0, 90.0),
    ("scanner.drop_out", 0.0, 0.999),
    ("scanner.spot_mm", 0.0, 100.0),
    ("scanner.baseline_mm", -FAR_MM, FAR_MM),
    ("line_scanner.rotation", -1.000001, 1.000001),
    ("line_scanner.translation_mm", -FAR_MM, FAR_MM),
    ("line_scanner.clearance_mm", 1e-3, 10_000.0),
    ("line_scanner.range_mm", 1e-3, 10_000.0),
    ("line_scanner.field_mm", 1e-3, 10_000.0),
    ("line_scanner.samples", 2.0, 10_000.0),
    ("line_scanner.pitch_um", 0.1, 1e5),
    ("line_scanner.baseline_mm", 1e-3, 10_000.0),
    ("line_scanner.camera_mm", -10_000.0, 10_000.0),
    ("line_scanner.noise_um", 0.0, 10_000.0),
    ("line_scanner.speckle_um", 0.0, 10_000.0),
    ("line_scanner.speckle_samples", 0.0, 1000.0),
    ("line_scanner.steepest_deg", 1.0, 90.0),
    ("line_scanner.gloss_deg", 0.0, 90.0),
    ("line_scanner.edge_share", 0.0, 1.0),
    ("line_scanner.exposure_us", 0.0, 1e6),
    ("line_scanner.busy_us", 0.0, 1e7),
    ("line_scanner.least_pulse_us", 0.0, 1e6),
    ("line_scanner.every_us", 0.0, 1e9),
    ("line_scanner.every_counts", 0.0, 1e9),
    ("line_scanner.clock_offset_us", 0.0, 1e15),
    ("line_scanner.clock_drift_ppm", -1e4, 1e4),
    ("line_scanner.encoder_axis", 0.0, 255.0),
    ("line_scanner.lost_share", 0.0, 1.0),
    ("line_scanner.repeated_share", 0.0, 1.0),
    ("offsets_mm.*", -FAR_MM, FAR_MM),
    ("tools.*.length_mm", 0.0, 1000.0),
    ("tools.*.radius_mm", 1e-3, 500.0),
    ("*.*.rotation_deg", -360.0, 360.0),
    // Sizes of bodies, and where bodies and groups stand.
    ("body.*.shape.*.*", 1e-6, 1e6),
    ("*.*.*", -FAR_MM, FAR_MM),
];

/// Refuses the first number that is out of its range.
pub(super) fn check(scene: &Table) -> Result<(), SceneError> {
    let mut path = Vec::new();
    for (key, value) in scene {
        path.push(key.clone());
        walk(&mut path, value, None)?;
        path.pop();
    }
    Ok(())
}

fn walk(path: &mut Vec<String>, value: &Value, item: Option<usize>) -> Result<(), SceneError> {
    match value {
        Value::Table(table) => {
            for (key, value) in table {
                path.push(key.clone());
                walk(path, value, None)?;
                path.pop();
            }
            Ok(())
        }
        Value::Array(list) => {
            for (value, number) in list.iter().zip(1..) {
                let Value::Table(entry) = value else {
                    walk(path, value, Some(number))?;
                    continue;
                };
                let name = entry.get("name").and_then(Value::as_str);
                path.push(name.map_or_else(|| format!("number {number}"), str::to_owned));
                walk(path, value, None)?;
                path.pop();
            }
            Ok(())
        }
        Value::Integer(whole) => number(path, *whole as f64, item),
        Value::Float(value) => number(path, *value, item),
        _ => Ok(()),
    }
}

fn number(path: &[String], value: f64, item: Option<usize>) -> Result<(), SceneError> {
    // What is in no row is no field either, and refused where the fields are read.
    let (least, most) = range(path).unwrap_or((f64::MIN, f64::MAX));
    if (least..=most).contains(&value) {
        return Ok(());
    }
    let name = match path {
        [kind, name, field @ ..] if kind == "body" || kind == "group" => {
            format!("{kind} {name}: `{}`", field.join("."))
        }
        _ => format!("`{}`", path.join(".")),
    };
    let which = item.map_or_else(String::new, |item| format!(", number {item} of its list,"));
    let message = format!("{name}{which} is {value}; give a number from {least} to {most}");
    Err(SceneError { message })
}

/// The row of a number.
fn range(path: &[String]) -> Option<(f64, f64)> {
    let fits = |name: &str| {
        let mut names = name.split('.');
        let all = path
            .iter()
            .all(|part| names.next().is_some_and(|name| name == "*" || name == part));
        all && names.next().is_none()
    };
    let row = RANGES.iter().find(|(name, ..)| fits(name))?;
    Some((row.1, row.2))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Scene;

    /// Every field of a scene that is a number, once for each name.
    const FULL: &str = r#"
        [machine]
        travel_min_mm = [-400.0, -300.0, -50.0]
        travel_max_mm = [400.0, 300.0, 400.0]
        reference_mm = [0.0, 0.0, 400.0]
        start_mm = [0.0, 0.0, 350.0]
        rapid_mm_per_min = 20000.0
        acceleration_mm_per_s2 = 2000.0
        position_gain_per_s = 30.0
        counts_per_mm = [10000.0, -10000.0, 10000.0]
        origin_counts = [5, -5, 0]
        index_counts = 40000
        homing_error_mm = [0.0, 0.0, 0.18]
        scale_error_ppm = [1.0, -1.0, 0.0]
        position_noise_um = 1.0
        drift_mm = [0.01, 0.0, -0.01]
        drift_time_s = 3600.0
        [control]
        skip_delay_ms = [0.0, 4.0]
        skip_poll_ms = 1.0
        baud = 4800
        bits = 11
        [control.nc]
        increment_mm = 0.001
        feed_mm_min = 25.0
        arc_tolerance_mm = 0.01
        second_reference_mm = [0.0, 0.0, 300.0]
        date = 20130101
        time = 120000
        limits = { blocks = 5, loops = 5, call_depth = 5, text = 500, programs = 5, names = 5 }
        [probe]
        tool = 99
        tip_radius_mm = 2.5
        length_mm = 100.0
        stem_radius_mm = 1.5
        stem_length_mm = 50.0
        pretravel_mm = 0.05
        lobing_mm = 0.005
        lobing_phase_deg = 90.0
        ovality_mm = -0.005
        axial_pretravel_mm = 0.001
        repeatability_um = 1.0
        filter_us = 10.0
        overtravel_mm = 5.0
        [[machine.rotary]]
        word = "A"
        carries = "workpiece"
        axis = [1.0, 0.0, 0.0]
        point_mm = [0.0, 0.0, -60.0]
        limits_deg = [-95.0, 95.0]
        start_deg = 1.0
        counts_per_deg = 1000.0
        origin_counts = 5
        deg_per_min = 3600.0
        [point_sensor]
        tool = 98
        offset_mm = [1.3, -0.8, -120.0]
        direction = [0.0, 0.0, -1.0]
        stand_off_mm = 44.0
        range_mm = 8.0
        spot_um = 37.0
        noise_um = 0.1
        linearity_percent = 0.08
        angle_deg = 85.0
        max_rate_hz = 9000.0
        gain_error_ppm = 20.0
        power_max = 4095.0
        [scanner]
        position_mm = [0, 0, 300]
        look_at_mm = [0, 0, 0]
        field_deg = [20, 20]
        distance_mm = 300
        spacing_mm = 1
        range_mm = [100, 500]
        noise_mm = 0.02
        shared_noise_mm = 0.01
        shared_length_mm = 15
        grazing_deg = 75
        drop_out = 0.01
        spot_mm = 0.3
        baseline_mm = 120
        [line_scanner]
        preset = "gocator"
        camera_mm = [1.0, 60.0, 130.0]
        rotation = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
        translation_mm = [0.0, 40.0, -130.0]
        clearance_mm = 90.0
        range_mm = 80.0
        field_mm = [47.0, 85.0]
        samples = 1280
        pitch_um = [44.0, 75.0]
        baseline_mm = 60.0
        noise_um = [6.0, 14.0]
        speckle_um = 3.0
        speckle_samples = 4.0
        steepest_deg = 80.0
        gloss_deg = 5.0
        edge_share = 0.2
        exposure_us = 300.0
        busy_us = 1000.0
        least_pulse_us = 20.0
        every_us = 0.0
        every_counts = 1600
        clock_offset_us = 123456.0
        clock_drift_ppm = -35.0
        encoder_axis = 0
        lost_share = 0.001
        repeated_share = 0.001
        [offsets_mm]
        "G54.1P1" = [1.0, 2.0, 3.0]
        [tools.1]
        length_mm = 100.0
        radius_mm = 4.0
        [[group]]
        name = "PLATE"
        translation_mm = [16.0, 0.0, 0.0]
        rotation_deg = [0.0, 0.0, -1.0]
        pivot_mm = [1.0, 2.0, 3.0]
        [[body]]
        name = "BALL"
        group = "PLATE"
        shape = { sphere = { radius_mm = 12.7 } }
        position_mm = [10.0, 0.0, 50.0]
        rotation_deg = [0.0, 90.0, 0.0]
        [[body]]
        name = "BLOCK"
        shape = { block = { size_mm = [10.0, 20.0, 30.0] } }
        [[body]]
        name = "BOSS"
        shape = { cylinder = { radius_mm = 10.0, height_mm = 5.0 } }
        [[body]]
        name = "RING"
        shape = { ring = { radius_mm = 10.0, outer_radius_mm = 20.0, height_mm = 5.0 } }
        [[body]]
        name = "ARC"
        shape = { arc = { radius_mm = 88.87, length_mm = 50.8, width_mm = 70.2, height_mm = 25.34 } }
    "#;

    /// The names of every number below a value.
    fn numbers(value: &Value, path: &[String], found: &mut Vec<Vec<String>>) {
        let below: Vec<(String, &Value)> = match value {
            Value::Table(table) => table.iter().map(|(k, v)| (k.clone(), v)).collect(),
            Value::Array(list) => (0..).map(|k: usize| k.to_string()).zip(list).collect(),
            Value::Integer(_) | Value::Float(_) => return found.push(path.to_vec()),
            _ => return,
        };
        for (key, value) in below {
            numbers(value, &[path, &[key]].concat(), found);
        }
    }

    /// The scene with one number replaced.
    fn with(path: &[String], number: f64) -> String {
        let mut scene = Value::Table(toml::from_str(FULL).unwrap());
        let mut place = &mut scene;
        for key in path {
            place = match place {
                Value::Array(list) => &mut list[key.parse::<usize>().unwrap()],
                table => &mut table[key.as_str()],
            };
        }
        *place = match place {
            Value::Integer(_) if number.is_finite() => Value::Integer(number as i64),
            _ => Value::Float(number),
        };
        toml::to_string(&scene).unwrap()
    }

    /// Each number of a full scene, replaced by `nan`, by an infinite one, or by one far
    /// beyond sense, is refused by a message that names its field and what to give.
    #[test]
    fn every_number_is_checked() {
        Scene::parse(FULL).unwrap();
        let scene = Value::Table(toml::from_str(FULL).unwrap());
        let mut found = Vec::new();
        numbers(&scene, &[], &mut found);
        assert!(found.len() > 90, "{}", found.len());
        for path in found {
            let field = path
                .iter()
                .rev()
                .find(|key| key.parse::<usize>().is_err())
                .unwrap();
            for number in [f64::NAN, f64::INFINITY, -f64::INFINITY, 4e18, -4e18] {
                let error = Scene::parse(&with(&path, number)).unwrap_err().message;
                assert!(
                    error.contains(field.as_str()) && error.contains("; give a number from"),
                    "{path:?} = {number}: {error}"
                );
            }
        }
    }

    /// Every row is of use: the full scene has a number for it, so no field's name is
    /// misspelt here.
    #[test]
    fn every_row_is_met() {
        let scene = Value::Table(toml::from_str(FULL).unwrap());
        let mut found = Vec::new();
        numbers(&scene, &[], &mut found);
        for (row, ..) in RANGES.iter().filter(|(row, ..)| !row.starts_with("*.*.*")) {
            let met = found.iter().any(|path| {
                let parts = row.split('.').filter(|part| *part != "*");
                parts.clone().count() > 0
                    && parts.clone().all(|part| path.iter().any(|p| p == part))
            });
            assert!(met, "{row}");
        }
    }

    /// What nonsense is told.
    #[test]
    fn nonsense_is_refused() {
        for (text, says) in [
            (
                "[[body]]\nname = \"B\"\nshape = \"half_space\"\nposition_mm = [nan, 0, 0]",
                "body B: `position_mm`, number 1 of its list, is NaN; give a number from -100000",
            ),
            (
                "[probe]\npretravel_mm = -1",
                "`probe.pretravel_mm` is -1; give a number from 0 to 10",
            ),
            ("[probe]\nfilter_us = -1e9", "`probe.filter_us`"),
            (
                "[tools.1]\nlength_mm = 1\nradius_mm = -4",
                "`tools.1.radius_mm` is -4",
            ),
            ("[control]\nbaud = 1\nbits = 4000000000", "`control.baud`"),
            ("[control]\nbits = 4000000000", "`control.bits`"),
            ("[machine]\nstart_mm = [501, 0, 0]", "`machine.start_mm`"),
            (
                "[machine]\nreference_mm = [0, 0, -501]",
                "`machine.reference_mm`",
            ),
            (
                "[machine]\ntravel_max_mm = [0, -500, 500]",
                "`machine.travel_max_mm`",
            ),
            (
                "[machine]\nposition_gain_per_s = 1e-9",
                "`machine.position_gain_per_s`",
            ),
            (
                "[machine]\ncounts_per_mm = [1, 0.1, 1]",
                "`machine.counts_per_mm`",
            ),
            (
                "[tools.1]\nlength_mm = 1\nradius_mm = 4\n[tools.01]\nlength_mm = 1\nradius_mm = 4",
                "tools.1: there are two",
            ),
        ] {
            let error = Scene::parse(text).unwrap_err().message;
            assert!(error.contains(says), "{text}: {error}");
        }
    }
}
