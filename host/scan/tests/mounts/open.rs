//! What the poses leave open, counted under noise: the right number of free motions from the geometry alone,
//! for each kind of set, and no well-posed set refused.

use super::*;

/// A set of poses and what they leave open.
struct Kind {
    name: &'static str,
    set: fn(Noise, &mut Random) -> Observations,
    options: fn() -> SensorOptions,
    /// How many motions of the mount nothing sees.
    free: u64,
    /// Their names, where each is one of the flange's own axes.
    names: &'static [&'static str],
}

const FLAT: Vector3<f64> = Vector3::new(0.0, 0.0, 1.0);
const SLANTED: Vector3<f64> = Vector3::new(0.3, -0.2, 1.0);
const ONLY_A: Swing = Swing {
    a_deg: 30.0,
    c_deg: 0.0,
    a_from_deg: 0.0,
};
const TILTED_C: Swing = Swing {
    a_from_deg: 20.0,
    ..ONLY_C
};
/// Turned about an axis by less than it can: noise shows more.
const LITTLE: Swing = Swing {
    a_deg: 10.0,
    c_deg: 25.0,
    a_from_deg: 0.0,
};

fn ball(swing: Swing, noise: Noise, random: &mut Random) -> Observations {
    spheres(&[BALL], 15.0, swing, noise, random)
}

fn stated() -> SensorOptions {
    on_sphere(Some(15.0))
}

fn sought() -> SensorOptions {
    on_sphere(None)
}

/// Two sets of poses, each of a feature of its own.
fn together(mut one: Observations, other: Observations) -> Observations {
    let (flanges, features) = (one.flanges.len(), one.features.len());
    one.flanges.extend(other.flanges);
    one.features
        .extend((0..other.features.len()).map(|i| (features + i).to_string()));
    one.points
        .extend(other.points.into_iter().map(|seen| Observation {
            flange: seen.flange + flanges,
            feature: seen.feature + features,
            ..seen
        }));
    one.slips = Vec::new();
    one
}

/// Why each number is right. The residual of a plane is `n·(q + R p + t) - d`, with n as the machine has it at
/// those angles. Where n stands still, a shift of any kind is one of d (3), and a turn about n moves
/// nothing off it (1). Where n goes around on a cone about one axis, the shift along that axis changes
/// d alone (1). Where n is square to C, C turns nothing, and A turns it in a plane square to A: the
/// shift along A is along the plane (1). A ball's centre takes any shift that the rotary axes carry
/// alike: all of them where they stand (3), that along the axis where one turns (1).
const OPEN: &[Kind] = &[
    Kind {
        name: "flat plane, axes still",
        set: |noise, random| plane(&FLAT, NONE, noise, random),
        options: on_plane,
        free: 4,
        names: &["tx", "ty", "tz", "wz"],
    },
    Kind {
        name: "inclined plane, axes still",
        set: |noise, random| plane(&SLANTED, NONE, noise, random),
        options: on_plane,
        free: 4,
        names: &[],
    },
    Kind {
        name: "flat plane, C turns",
        set: |noise, random| plane(&FLAT, ONLY_C, noise, random),
        options: on_plane,
        free: 4,
        names: &["tx", "ty", "tz", "wz"],
    },
    Kind {
        name: "flat plane, A at 20 degrees, C turns",
        set: |noise, random| plane(&FLAT, TILTED_C, noise, random),
        options: on_plane,
        free: 4,
        names: &[],
    },
    Kind {
        name: "two flat planes, C turns",
        set: |noise, random| {
            let one = plane(&FLAT, ONLY_C, noise, random);
            together(one, plane(&FLAT, ONLY_C, noise, random))
        },
        options: on_plane,
        free: 4,
        names: &["tx", "ty", "tz", "wz"],
    },
    Kind {
        name: "flat plane, A and C turn",
        set: |noise, random| plane(&FLAT, BOTH, noise, random),
        options: on_plane,
        free: 1,
        names: &["tx"],
    },
    Kind {
        name: "flat plane, A and C turn a little",
        set: |noise, random| plane(&FLAT, LITTLE, noise, random),
        options: on_plane,
        free: 1,
        names: &["tx"],
    },
    Kind {
        name: "flat plane, A turns",
        set: |noise, random| plane(&FLAT, ONLY_A, noise, random),
        options: on_plane,
        free: 1,
        names: &["tx"],
    },
    Kind {
        name: "inclined plane, A turns",
        set: |noise, random| plane(&SLANTED, ONLY_A, noise, random),
        options: on_plane,
        free: 1,
        names: &["tx"],
    },
    Kind {
        name: "inclined plane, C turns",
        set: |noise, random| plane(&SLANTED, ONLY_C, noise, random),
        options: on_plane,
        free: 1,
        names: &["tz"],
    },
    Kind {
        name: "inclined plane, A at 20 degrees, C turns",
        set: |noise, random| plane(&SLANTED, TILTED_C, noise, random),
        options: on_plane,
        free: 1,
        names: &[],
    },
    Kind {
        name: "two inclined planes, axes still",
        set: |noise, random| {
            let one = plane(&SLANTED, NONE, noise, random);
            together(one, plane(&FLAT, NONE, noise, random))
        },
        options: on_plane,
        free: 3,
        names: &["tx", "ty", "tz"],
    },
    Kind {
        name: "ball, axes still",
        set: |noise, random| ball(NONE, noise, random),
        options: stated,
        free: 3,
        names: &["tx", "ty", "tz"],
    },
    Kind {
        name: "ball, its radius free, axes still",
        set: |noise, random| ball(NONE, noise, random),
        options: sought,
        free: 3,
        names: &["tx", "ty", "tz"],
    },
    Kind {
        name: "two balls, axes still",
        set: |noise, random| spheres(&BALLS, 15.0, NONE, noise, random),
        options: stated,
        free: 3,
        names: &["tx", "ty", "tz"],
    },
    Kind {
        name: "ball, C turns",
        set: |noise, random| ball(ONLY_C, noise, random),
        options: stated,
        free: 1,
        names: &["tz"],
    },
    Kind {
        name: "ball, its radius free, A turns",
        set: |noise, random| ball(ONLY_A, noise, random),
        options: sought,
        free: 1,
        names: &["tx"],
    },
    Kind {
        name: "ball, A at 20 degrees, C turns",
        set: |noise, random| ball(TILTED_C, noise, random),
        options: stated,
        free: 1,
        names: &[],
    },
];

fn seeds() -> u64 {
    std::env::var("UMI_SEEDS").map_or(4, |seeds| seeds.parse().unwrap())
}

fn each(kinds: &[Kind], mut look: impl FnMut(&Kind, &str, Result<SensorAnswer, ScanError>)) {
    for kind in kinds {
        for um in [0.0, 1.0, 5.0, 10.0, 20.0] {
            for seed in 0..seeds() {
                let mut random = Random(1000 * seed + um as u64);
                let noise = if seed % 2 == 0 {
                    Noise::Distance(um / 1000.0)
                } else {
                    Noise::Range(um / 1000.0)
                };
                let all = (kind.set)(noise, &mut random);
                let found = sensor(&all, &guess(&mut random), &(kind.options)());
                look(kind, &format!("{}, {um} um, seed {seed}", kind.name), found);
            }
        }
    }
}

/// By hand, with `UMI_SEEDS=100`: the same of more sets.
#[test]
fn noise_hides_no_free_motion() {
    let mut wrong = Vec::new();
    each(OPEN, |kind, what, found| match found {
        Ok(_) => wrong.push(format!("{what}: answered")),
        Err(error) if error.code != "unidentifiable" => wrong.push(format!("{what}: {error}")),
        Err(error) => {
            let free = error.details["free"].as_u64().unwrap();
            let names = error.details["unobservable"].as_array().unwrap();
            let mut names: Vec<&str> = names.iter().map(|name| name.as_str().unwrap()).collect();
            names.sort_unstable();
            if free != kind.free || !kind.names.is_empty() && names != kind.names {
                wrong.push(format!("{what}: {free} of {}, {names:?}", kind.free));
            }
        }
    });
    assert!(
        wrong.is_empty(),
        "{} wrong:\n{}",
        wrong.len(),
        wrong.join("\n")
    );
}

/// Ill-judged noise would refuse these.
#[test]
fn what_the_poses_determine_is_answered_at_any_noise() {
    const WELL: &[Kind] = &[
        Kind {
            name: "inclined plane",
            set: |noise, random| plane(&SLANTED, BOTH, noise, random),
            options: on_plane,
            free: 0,
            names: &[],
        },
        Kind {
            name: "plane inclined by 8 degrees",
            set: |noise, random| plane(&Vector3::new(0.11, -0.08, 1.0), BOTH, noise, random),
            options: on_plane,
            free: 0,
            names: &[],
        },
        Kind {
            name: "ball",
            set: |noise, random| ball(BOTH, noise, random),
            options: stated,
            free: 0,
            names: &[],
        },
        Kind {
            name: "ball, axes turn a little",
            set: |noise, random| ball(LITTLE, noise, random),
            options: stated,
            free: 0,
            names: &[],
        },
        Kind {
            name: "ball, its radius free",
            set: |noise, random| ball(BOTH, noise, random),
            options: sought,
            free: 0,
            names: &[],
        },
        Kind {
            name: "two balls whose centres are known, axes still",
            set: |noise, random| spheres(&BALLS, 15.0, NONE, noise, random),
            options: || SensorOptions {
                centres: Some(
                    BALLS
                        .iter()
                        .enumerate()
                        .map(|(i, at)| (i.to_string(), *at))
                        .collect(),
                ),
                ..stated()
            },
            free: 0,
            names: &[],
        },
    ];
    let mut wrong = Vec::new();
    each(WELL, |_, what, found| {
        if let Err(error) = found {
            wrong.push(format!("{what}: {error}"));
        }
    });
    assert!(
        wrong.is_empty(),
        "{} wrong:\n{}",
        wrong.len(),
        wrong.join("\n")
    );
}
