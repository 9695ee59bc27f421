//! Files of readings, balls and calibrations: read, or refused by name, never a panic.

use proptest::prelude::*;
use umi_core::point::PointQuestion;

use super::calibration::{self, CalibrationQuestion, KnownSensor};
use super::plan::{self, PlanQuestion};
use super::program::{ProgramLanguage, program};
use super::readings::{SensorReading, SensorReadings, from_table};
use super::{cloud, spheres};
use crate::format::table::TableReader;
use crate::rigid::Vec3;
use crate::{Ending, ScanError};

const BALL: &str = "[[sphere]]\nid = 1\ncenter_mm = [200, -100.0, -600]\nradius_mm = 10\n";

fn readings(text: &[u8], min_snr: Option<f64>) -> Result<SensorReadings, ScanError> {
    from_table(TableReader::new(text, "readings".into())?, min_snr)
}

fn code(text: &str, min_snr: Option<f64>) -> &'static str {
    let error = readings(text.as_bytes(), min_snr).unwrap_err();
    assert_eq!(error.ending, Ending::Refused, "{error}");
    error.code
}

fn question() -> CalibrationQuestion {
    CalibrationQuestion {
        wanted: PointQuestion::default(),
        max_rms_mm: None,
    }
}

fn planned() -> PlanQuestion {
    PlanQuestion {
        center_mm: [200.0, -100.0, -600.0],
        radius_mm: 10.0,
        u_center_mm: 0.0,
        offset_mm: [3.2, -54.3, -138.1],
        direction: [0.01, 0.02, -1.0],
        stand_off_mm: 44.0,
        range_mm: 8.0,
        angle_deg: 85.0,
        stand_offs: 3,
        places: 25,
        sigma_mm: 0.001,
        increment_mm: 0.001,
        safe_z_mm: -300.0,
    }
}

/// Readings as a plan's places would give them.
fn of_plan(plan: &plan::SensorPlan) -> SensorReadings {
    SensorReadings {
        lines: plan.places.len(),
        used: plan
            .places
            .iter()
            .map(|place| SensorReading {
                line: 0,
                axes_mm: place.axes_mm,
                gamma_mm: place.gamma_mm,
                sphere: None,
            })
            .collect(),
    }
}

#[test]
fn readings_go_by_their_columns() {
    let text = b"total,z,snr,gamma,y,x,sphere\n9,3,800,40,2,1,A\n9,3,,nan,2,1,A\n9,3,10,,2,1,A\n";
    let read = readings(text, Some(100.0)).unwrap();
    assert_eq!((read.lines, read.used.len()), (3, 1));
    assert_eq!(read.used[0].axes_mm, [1.0, 2.0, 3.0]);
    assert_eq!(read.used[0].sphere.as_deref(), Some("A"));
}

/// The places that a board has measured are readings; those without a point are none.
#[test]
fn measured_places_are_readings() {
    let text = "row,col,x_mm,y_mm,z_mm,gamma_mm,qx_mm,qy_mm,qz_mm,snr,total,status\n\
                0,0,9,9,9,44.5,1,2,3,80,3000,ok\n0,1,,,,,,,,,,out_of_range\n";
    let read = readings(text.as_bytes(), None).unwrap();
    assert_eq!((read.lines, read.used.len()), (2, 1));
    assert_eq!(
        (read.used[0].axes_mm, read.used[0].gamma_mm),
        ([1.0, 2.0, 3.0], 44.5)
    );
}

#[test]
fn readings_are_refused_by_name() {
    assert_eq!(code("x,y,gamma\n1,2,3\n", None), "missing_column");
    assert_eq!(code("x,y,z,gamma\n1,2,3,4\n", Some(1.0)), "missing_column");
    assert_eq!(code("x,y,z,gamma\n1,2,3,four\n", None), "not_a_number");
    assert_eq!(code("x,y,z,gamma\n1,2,,4\n", None), "not_a_number");
    assert_eq!(code("x,y,z,gamma\n1,2,3\n", None), "not_a_number");
    assert_eq!(code("x,y,z,gamma\n1,2,3,nan\n", None), "not_finite");
    assert_eq!(code("x,y,z,gamma\n1,-inf,3,4\n", None), "not_finite");
    assert_eq!(code("x,y,z,gamma\n1,2,3,1e300\n", None), "not_finite");
}

#[test]
fn balls_are_refused_by_name() {
    assert_eq!(spheres::parse(BALL).unwrap().ids, ["1"]);
    for (from, to, code) in [
        ("radius_mm = 10", "radius_mm = 0", "bad_sphere"),
        ("radius_mm = 10", "radius_mm = nan", "bad_sphere"),
        ("radius_mm = 10", "", "bad_sphere"),
        (
            "radius_mm = 10",
            "radius_mm = 10\nu_center_mm = -1",
            "bad_sphere",
        ),
        ("radius_mm = 10", "radius_mm = 10\ncolour = 1", "bad_sphere"),
        ("center_mm = [200, -100.0, -600]", "", "center_unknown"),
        ("[200, -100.0, -600]", "[200, -100.0]", "bad_sphere"),
        ("[200, -100.0, -600]", "[200, -100.0, inf]", "bad_sphere"),
        ("id = 1", "id = ", "bad_sphere"),
        (BALL, "", "bad_sphere"),
    ] {
        let error = spheres::parse(&BALL.replace(from, to)).unwrap_err();
        assert_eq!((error.code, error.ending), (code, Ending::Refused), "{to}");
    }
    let twice = format!("{BALL}{BALL}");
    assert_eq!(spheres::parse(&twice).unwrap_err().code, "bad_sphere");
    let alike = format!("{BALL}{}", BALL.replace("id = 1", "id = '1.0'"));
    assert_eq!(spheres::parse(&alike).unwrap_err().code, "bad_sphere");
    let two = format!("{BALL}{}", BALL.replace("id = 1", "id = 'B'"));
    let two = spheres::parse(&two).unwrap();
    let of = |sphere: Option<&str>| {
        let read = SensorReading {
            line: 2,
            axes_mm: [0.0; 3],
            gamma_mm: 40.0,
            sphere: sphere.map(str::to_owned),
        };
        two.of(&read).map_err(|error| error.code)
    };
    assert_eq!((of(Some("B")), of(Some("1.0"))), (Ok(1), Ok(0)));
    assert_eq!(of(Some("C")), Err("unknown_sphere"));
    assert_eq!(of(None), Err("missing_column"));
}

#[test]
fn a_plan_determines_what_it_promises() {
    let question = planned();
    let plan = plan::plan(&question).unwrap();
    assert_eq!(plan.places.len(), 25);
    for place in &plan.places {
        assert!((40.0..48.0).contains(&place.gamma_mm), "{place:?}");
        assert!(place.incidence_deg < 85.0, "{place:?}");
    }
    // A point is known far better than the offset.
    assert!(plan.u_point_mm[0] < 0.001 && plan.u_offset_mm[0] > 0.005);
    let ball = spheres::parse(BALL).unwrap();
    let found = calibration::find(&of_plan(&plan), &ball, &self::question()).unwrap();
    assert!((Vec3::from(found.offset_mm) - Vec3::from(question.offset_mm)).amax() < 1e-9);
    assert!(found.warnings.is_empty(), "{:?}", found.warnings);
    // The centre's own uncertainty goes into the offset whole.
    let unsure = PlanQuestion {
        u_center_mm: 0.01,
        ..question
    };
    assert!(plan::plan(&unsure).unwrap().u_point_mm[0] > 0.01);
    for (language, says) in [
        (ProgramLanguage::MacroB, "DPRNT[N"),
        (ProgramLanguage::LinuxCnc, "(LOG,%.3f#<_abs_x>"),
        (ProgramLanguage::Grbl, "M0\n"),
    ] {
        let text = program(&unsure, &plan, language);
        assert_eq!(text.matches(says).count(), 25, "{language:?}");
    }
}

#[test]
fn plans_that_make_no_sense_are_refused() {
    let refused = |change: fn(&mut PlanQuestion)| {
        let mut question = planned();
        change(&mut question);
        plan::plan(&question).unwrap_err().code
    };
    assert_eq!(refused(|q| q.stand_offs = 1), "bad_input");
    assert_eq!(refused(|q| q.places = 5), "bad_input");
    assert_eq!(refused(|q| q.range_mm = f64::NAN), "bad_input");
    assert_eq!(refused(|q| q.direction = [0.0, 0.0, 1.0]), "bad_input");
    assert_eq!(refused(|q| q.safe_z_mm = -1000.0), "bad_input");
}

/// A calibration that was written is read back, and gives the same points.
#[test]
fn a_calibration_comes_back_from_its_file() {
    let mut read = of_plan(&plan::plan(&planned()).unwrap());
    for (k, reading) in read.used.iter_mut().enumerate() {
        reading.gamma_mm += 1e-3 * ((k * 7 % 11) as f64 / 5.0 - 1.0);
    }
    let ball = spheres::parse(BALL).unwrap();
    let found = calibration::find(&read, &ball, &question()).unwrap();
    let text = serde_json::to_vec(&found).unwrap();
    let known = calibration::parse(&text).unwrap();
    // The reader of JSON may round the last bit the other way.
    assert!((known.sensor.direction - Vec3::from(found.direction)).amax() < 1e-15);
    let (read_back, written) = (
        known.covariance.unwrap()[0][0],
        found.covariance.unwrap()[0][0],
    );
    assert!((read_back / written - 1.0).abs() < 1e-15);
    let made = cloud::points(&read, &known, known.covariance_total.as_ref());
    for (p, (d, u)) in made
        .points
        .iter()
        .zip(found.residuals_mm.iter().zip(made.u_mm.as_ref().unwrap()))
    {
        let from_center = (p - Vec3::new(200.0, -100.0, -600.0)).norm() - 10.0;
        assert!((from_center - d).abs() < 1e-12);
        assert!(u.iter().all(|u| (0.0..0.005).contains(u)), "{u:?}");
    }
    let mut wild = read.clone();
    wild.used[4].gamma_mm = 1e6;
    let error = calibration::find(&wild, &ball, &question()).unwrap_err();
    assert_eq!(error.code, "residual_too_large");
    let line = format!("line {}", wild.used[4].line);
    assert!(error.message.contains(&line), "{}", error.message);
    let limit = CalibrationQuestion {
        max_rms_mm: Some(1e-5),
        ..question()
    };
    let error = calibration::find(&read, &ball, &limit).unwrap_err();
    assert_eq!(error.code, "residual_too_large");
}

#[test]
fn calibrations_are_refused_by_name() {
    let good =
        r#"{"kind":"point_sensor","offset_mm":[1,2,3],"direction":[0,0,-1],"covariance":null}"#;
    let known = calibration::parse(good.as_bytes()).unwrap();
    assert_eq!((known.sensor.gain, known.covariance), (1.0, None));
    // No covariance: a variance below zero, a correlation above one, not symmetric.
    let matrix = |spoil: fn(&mut [[f64; 6]; 6])| {
        let mut all = [[0.0; 6]; 6];
        for (index, row) in all.iter_mut().enumerate().take(5) {
            row[index] = 1e-6;
        }
        spoil(&mut all);
        calibration::parse(good.replace("null", &format!("{all:?}")).as_bytes())
    };
    matrix(|_| {}).unwrap();
    for spoil in [
        (|all| all[1][1] = -1e-6) as fn(&mut [[f64; 6]; 6]),
        |all| (all[0][1], all[1][0]) = (2e-6, 2e-6),
        |all| all[3][0] = 1e-7,
    ] {
        assert_eq!(matrix(spoil).unwrap_err().code, "bad_calibration");
    }
    for (from, to) in [
        ("point_sensor", "profile"),
        ("[0,0,-1]", "[0,0,-1.1]"),
        ("[1,2,3]", "[1,2]"),
        ("null", "[[1]]"),
        ("null}", "null,\"gain\":0}"),
        ("{", ""),
    ] {
        let error = calibration::parse(good.replacen(from, to, 1).as_bytes()).unwrap_err();
        assert_eq!(error.code, "bad_calibration", "{to}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn no_bytes_make_a_reader_panic(
        bytes in prop::collection::vec(any::<u8>(), 0..200),
        cells in prop::collection::vec("[-+0-9a-z.,;\n\"#]{0,12}", 0..30),
        min_snr in prop::option::of(-1.0..1.0_f64),
    ) {
        let text = cells.join(",");
        let headed = format!("x,y,z,gamma,sphere,snr\n{text}");
        for input in [bytes.as_slice(), headed.as_bytes()] {
            if let Ok(read) = readings(input, min_snr)
                && let Ok(balls) = spheres::parse(BALL)
            {
                let _ = calibration::find(&read, &balls, &question());
            }
            let _ = spheres::parse(&String::from_utf8_lossy(input));
            let _ = calibration::parse(input);
        }
        let _ = spheres::parse(&format!("{BALL}{text}"));
    }

    /// A reading's point is Q + t + γ g a.
    #[test]
    fn points_are_where_the_formula_says(x in -500.0..500.0_f64, gamma in 0.0..100.0_f64, gain in 0.9..1.1_f64) {
        let json = format!(r#"{{"kind":"point_sensor","offset_mm":[1,2,3],"direction":[0.6,0,-0.8],"gain":{gain}}}"#);
        let known: KnownSensor = calibration::parse(json.as_bytes()).unwrap();
        let text = format!("x,y,z,gamma\n{x},0,0,{gamma}\n");
        let made = cloud::points(&readings(text.as_bytes(), None).unwrap(), &known, None);
        let wanted = Vec3::new(x + 1.0 + 0.6 * gamma * gain, 2.0, 3.0 - 0.8 * gamma * gain);
        prop_assert!((made.points[0] - wanted).amax() < 1e-12);
    }
}

/// What the offset would take up, with status 0: a wrong radius, a wrong gain, one wrong reading, readings given twice,
/// readings that leave the direction open. Each is told, with its figure; good readings are not.
#[test]
fn what_the_offset_would_take_up_is_told() {
    let mut planned = planned();
    planned.places = 57;
    let plan = plan::plan(&planned).unwrap();
    let told = |seed: u64, change: fn(&mut Vec<SensorReading>), ball: &str| {
        let mut noise = noise_of(seed);
        let mut readings = of_plan(&plan);
        for (index, reading) in readings.used.iter_mut().enumerate() {
            reading.line = index as u64 + 2;
            reading.gamma_mm += noise();
        }
        change(&mut readings.used);
        readings.lines = readings.used.len();
        let found = calibration::find(&readings, &spheres::parse(ball).unwrap(), &question());
        found.unwrap().warnings
    };
    let larger = BALL.replace("radius_mm = 10", "radius_mm = 10.01");
    for seed in 1..30 {
        assert_eq!(told(seed, |_| {}, BALL), Vec::<String>::new(), "{seed}");
        let one = |warnings: Vec<String>, name: &str| {
            let [warning] = warnings.as_slice() else {
                panic!("{seed}: {warnings:?}");
            };
            assert!(warning.starts_with(name), "{seed}: {warning}");
            warning.clone()
        };
        let radius = one(told(seed, |_| {}, &larger), "radius:");
        assert!(
            radius.contains("radius of 9.99") || radius.contains("radius of 10.00"),
            "{radius}"
        );
        let longer = |used: &mut Vec<SensorReading>| {
            for reading in used {
                reading.gamma_mm *= 1.01;
            }
        };
        one(told(seed, longer, BALL), "gain:");
        let wrong = |used: &mut Vec<SensorReading>| used[7].gamma_mm += 0.05;
        assert!(one(told(seed, wrong, BALL), "outlier:").contains("line 9 "));
        let twice = |used: &mut Vec<SensorReading>| {
            let first = used[0].clone();
            used.push(first);
        };
        assert!(one(told(seed, twice, BALL), "repeated:").contains(" 1 readings"));
        let alike = |used: &mut Vec<SensorReading>| {
            for reading in used {
                let near = 44.0 + (reading.gamma_mm - 44.0) / 100.0;
                // The axes follow along the beam.
                let beam = Vec3::new(0.01, 0.02, -1.0).normalize() * (reading.gamma_mm - near);
                for (axis, moved) in reading.axes_mm.iter_mut().zip(beam.iter()) {
                    *axis += moved;
                }
                reading.gamma_mm = near;
            }
        };
        assert!(
            told(seed, alike, BALL)
                .iter()
                .any(|told| told.starts_with("weak:"))
        );
    }
}

/// Noise of 0.5 µm, or so.
fn noise_of(mut state: u64) -> impl FnMut() -> f64 {
    move || {
        let mut sum = 0.0;
        for _ in 0..12 {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            sum += (state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5;
        }
        sum * 0.0005
    }
}

/// Two balls 250 mm apart, seen along scales that are 10.6 ppm too long, by the paper: told with its
/// figure. Cold ones are not, nor where the centres are known to 5 µm only.
#[test]
fn a_warm_scale_is_named() {
    let warned = |ppm: f64, u_center_mm: f64, seed: u64| {
        let mut balls = String::new();
        let mut used = Vec::new();
        let mut noise = noise_of(seed);
        for (id, x) in [("A", -125.0), ("B", 124.53)] {
            let question = PlanQuestion {
                center_mm: [x, 20.0, -300.0],
                safe_z_mm: 0.0,
                ..planned()
            };
            balls += &format!(
                "[[sphere]]\nid = \"{id}\"\ncenter_mm = [{x}, 20.0, -300.0]\nradius_mm = 10.0\nu_center_mm = {u_center_mm}\n"
            );
            for place in plan::plan(&question).unwrap().places {
                let seen = place.axes_mm.map(|mm| mm * (1.0 - ppm * 1e-6) + noise());
                used.push(SensorReading {
                    line: 0,
                    axes_mm: seen,
                    gamma_mm: place.gamma_mm,
                    sphere: Some(id.to_owned()),
                });
            }
        }
        let lines = used.len();
        let readings = SensorReadings { lines, used };
        let found =
            calibration::find(&readings, &spheres::parse(&balls).unwrap(), &question()).unwrap();
        let json = serde_json::to_vec(&found).unwrap();
        let known = calibration::parse(&json).unwrap();
        let told = known.scale_warning();
        told.map(|told| {
            let after = told.split("should be ").nth(1).unwrap();
            after.split(' ').next().unwrap().parse::<f64>().unwrap()
        })
    };
    for seed in 1..40 {
        assert_eq!(warned(0.0, 0.0, seed), None, "{seed}");
        assert_eq!(warned(10.6, 0.005, seed), None, "{seed}");
        let told = warned(10.6, 0.0001, seed).unwrap();
        assert!((told - 10.6).abs() < 5.0, "{seed}: {told}");
    }
}

/// Eight readings: what they say of their own scatter is told beforehand and afterwards, with Student's factor. Thirteen
/// say enough, and readings without scatter state no uncertainty.
#[test]
fn few_readings_are_told() {
    let of = |places: usize, stand_offs: usize| {
        let question = PlanQuestion {
            places,
            stand_offs,
            ..planned()
        };
        let plan = plan::plan(&question).unwrap();
        let ball = spheres::parse(BALL).unwrap();
        let exact = of_plan(&plan);
        let found = calibration::find(&exact, &ball, &self::question()).unwrap();
        assert_eq!(found.warnings, Vec::<String>::new());
        let mut noise = noise_of(places as u64);
        let mut readings = exact;
        for reading in &mut readings.used {
            reading.gamma_mm += noise();
        }
        let found = calibration::find(&readings, &ball, &self::question()).unwrap();
        (plan.warnings, found.warnings)
    };
    let (planned, found) = of(8, 2);
    let told = "weak: few readings, 3 more than unknowns: ";
    assert!(
        planned[0].starts_with(told) && planned[0].contains("within 3.2 times u"),
        "{planned:?}"
    );
    assert_eq!(found.first(), planned.first(), "{found:?}");
    let none = Vec::<String>::new();
    assert_eq!(of(13, 3), (none.clone(), none));
}

/// Readings over 0.1 mm do not show their gain: that is said, and not that direction, balls or unit are wrong.
#[test]
fn a_gain_that_is_open_is_named() {
    const TEXT: &str = "x,y,z,gamma\n\
        176.397575835,120.517783733,-220.856832942,45.545185816\n\
        179.533264151,119.634644958,-223.473326473,45.576361805\n\
        171.953193768,122.704169164,-220.078780377,45.485646059\n\
        173.518022473,118.440571077,-221.016549731,45.489233905\n\
        175.230722859,122.329197199,-220.267150333,45.504764354\n\
        176.212313714,126.363272571,-221.520395399,45.515019722\n\
        179.668396408,119.162536935,-224.021085157,45.518191769\n\
        176.789154600,124.695173226,-221.113092820,45.516165431\n\
        176.366232881,118.850680225,-221.502405997,45.507562355\n\
        171.743656811,119.963584210,-220.468812775,45.506903556\n\
        178.840794698,127.717132092,-224.695055018,45.484943770\n\
        179.590231669,121.987314071,-222.842520627,45.559562959\n\
        176.252833433,128.990596175,-223.768095077,45.491785552\n\
        174.985923087,121.390627007,-220.210590876,45.575807228\n\
        171.170798130,124.569353082,-220.447553723,45.499356783\n\
        176.010262260,128.199640189,-222.754418601,45.502696725\n\
        172.115601524,123.612930384,-220.045667168,45.578710984\n\
        178.479838550,121.515585070,-221.894827356,45.535967922\n\
        171.484644740,122.790256036,-220.081115815,45.570769763\n\
        175.900351942,119.175776603,-221.112685368,45.553046863\n";
    let ball = "[[sphere]]\nid = 1\ncenter_mm = [32.992526422,89.566527663,-197.491994257]\nradius_mm = 8.819816684\n";
    let ball = spheres::parse(ball).unwrap();
    let readings = readings(TEXT.as_bytes(), None).unwrap();
    let mut question = question();
    question.wanted.noise = umi_core::point::ResidualNoise::AlongBeam;
    calibration::find(&readings, &ball, &question).unwrap();
    question.wanted.free_gain = true;
    let error = calibration::find(&readings, &ball, &question).unwrap_err();
    assert_eq!(error.code, "degenerate", "{error}");
    assert!(
        error.message.contains("the gain") && error.message.contains("--free gain"),
        "{error}"
    );
}
