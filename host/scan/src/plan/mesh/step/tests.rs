//! A file of Open CASCADE's, what damage does to it, and shapes whose areas are known.

use std::f64::consts::PI;
use std::fmt::Write as _;

use super::super::PartMesh;
use super::read;

const WAVY: &str = include_str!("../../../../../../tests/reference/plan/step_wavy.step");

fn area(text: &str) -> f64 {
    let part = PartMesh::weld(read(text.as_bytes()).unwrap(), true).unwrap();
    part.surface.area_mm2()
}

/// A shell of faces as text, in mm.
fn shell(faces: &str) -> String {
    format!(
        "ISO-10303-21;\nHEADER;\nFILE_NAME('it''s; DATA;','','',(''),'','','');\nENDSEC;\nDATA;\n\
         #1=(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MILLI.,.METRE.));\n#2=DIRECTION('',(0.,0.,1.));\n\
         #3=DIRECTION('',(1.,0.,0.));\n#4=CARTESIAN_POINT('',(0.,0.,0.));\n#5=AXIS2_PLACEMENT_3D('',#4,#2,#3);\n\
         {faces}ENDSEC;\nEND-ISO-10303-21;\n"
    )
}

/// A border of straight edges and arcs about the origin: corners, and whether the edge behind each is an arc.
struct Outline {
    text: String,
    next: u32,
}

impl Outline {
    fn new(first: u32) -> Self {
        Self {
            text: String::new(),
            next: first,
        }
    }

    fn add(&mut self, entity: &str) -> u32 {
        let number = self.next;
        self.next += 1;
        writeln!(self.text, "#{number}={entity};").unwrap();
        number
    }

    /// Edges from corner to corner; `curves` are entity texts with their sense.
    fn ring(&mut self, corners: &[[f64; 3]], curves: &[(String, bool)]) -> u32 {
        let vertices: Vec<u32> = corners
            .iter()
            .map(|[x, y, z]| {
                let point = self.add(&format!("CARTESIAN_POINT('',({x:?},{y:?},{z:?}))"));
                self.add(&format!("VERTEX_POINT('',#{point})"))
            })
            .collect();
        let mut edges = Vec::new();
        for (k, (curve, along)) in curves.iter().enumerate() {
            let curve = self.add(curve);
            let (from, to) = (vertices[k], vertices[(k + 1) % vertices.len()]);
            let (from, to) = if *along { (from, to) } else { (to, from) };
            let edge = self.add(&format!("EDGE_CURVE('',#{from},#{to},#{curve},.T.)"));
            let sense = if *along { 'T' } else { 'F' };
            edges.push(self.add(&format!("ORIENTED_EDGE('',*,*,#{edge},.{sense}.)")));
        }
        let list: Vec<String> = edges.iter().map(|e| format!("#{e}")).collect();
        let ring = self.add(&format!("EDGE_LOOP('',({}))", list.join(",")));
        self.add(&format!("FACE_BOUND('',#{ring},.T.)"))
    }

    fn close(mut self, surface: &str, bounds: &[u32]) -> String {
        let surface = self.add(surface);
        let list: Vec<String> = bounds.iter().map(|b| format!("#{b}")).collect();
        let face = self.add(&format!(
            "ADVANCED_FACE('',({}),#{surface},.T.)",
            list.join(",")
        ));
        self.add(&format!("OPEN_SHELL('',(#{face}))"));
        shell(&self.text)
    }
}

const LINE: &str = "LINE('',#4,#4)";

#[test]
fn a_spline_of_open_cascade_is_its_surface_within_the_chord() {
    let part = PartMesh::weld(read(WAVY.as_bytes()).unwrap(), true).unwrap();
    assert_eq!(part.components, 1);
    // The area that a fine mesh of the same surface has.
    assert!(
        (part.surface.area_mm2() - 5276.4).abs() < 1.0,
        "{}",
        part.surface.area_mm2()
    );
    let border = part
        .neighbours
        .iter()
        .flatten()
        .filter(|n| **n == super::super::weld::BORDER);
    assert!(border.count() > 20);
    // All look up.
    assert!(part.surface.triangles().iter().all(|t| t.normal.z > 0.5));
}

#[test]
fn a_plane_with_a_round_hole() {
    let mut o = Outline::new(10);
    let corners = [
        [-20.0, -15.0, 0.0],
        [20.0, -15.0, 0.0],
        [20.0, 15.0, 0.0],
        [-20.0, 15.0, 0.0],
    ];
    let outer = o.ring(
        &corners,
        &[
            (LINE.into(), true),
            (LINE.into(), true),
            (LINE.into(), true),
            (LINE.into(), false),
        ],
    );
    let hole = o.ring(&[[6.0, 0.0, 0.0]], &[("CIRCLE('',#5,6.)".into(), true)]);
    let found = area(&o.close("PLANE('',#5)", &[outer, hole]));
    assert!((found - (1200.0 - 36.0 * PI)).abs() < 0.2, "{found}");
}

#[test]
fn a_whole_cylinder_with_its_seam_closes_to_a_ring() {
    let mut o = Outline::new(10);
    // Up the seam, round at the top, down the seam, round at the bottom: one edge twice.
    let text = {
        let at = |o: &mut Outline, z: f64| {
            let point = o.add(&format!("CARTESIAN_POINT('',(10.,0.,{z:?}))"));
            let vertex = o.add(&format!("VERTEX_POINT('',#{point})"));
            let middle = o.add(&format!("CARTESIAN_POINT('',(0.,0.,{z:?}))"));
            let frame = o.add(&format!("AXIS2_PLACEMENT_3D('',#{middle},#2,#3)"));
            let circle = o.add(&format!("CIRCLE('',#{frame},10.)"));
            let edge = o.add(&format!("EDGE_CURVE('',#{vertex},#{vertex},#{circle},.T.)"));
            (vertex, edge)
        };
        let (low, below) = at(&mut o, 0.0);
        let (high, above) = at(&mut o, 25.0);
        let line = o.add(LINE);
        let seam = o.add(&format!("EDGE_CURVE('',#{low},#{high},#{line},.T.)"));
        let ring: Vec<String> = [(below, 'T'), (seam, 'T'), (above, 'F'), (seam, 'F')]
            .iter()
            .map(|(edge, sense)| {
                let n = o.add(&format!("ORIENTED_EDGE('',*,*,#{edge},.{sense}.)"));
                format!("#{n}")
            })
            .collect();
        let ring = o.add(&format!("EDGE_LOOP('',({}))", ring.join(",")));
        let bound = o.add(&format!("FACE_OUTER_BOUND('',#{ring},.T.)"));
        o.close("CYLINDRICAL_SURFACE('',#5,10.)", &[bound])
    };
    let part = PartMesh::weld(read(text.as_bytes()).unwrap(), true).unwrap();
    let found = part.surface.area_mm2();
    assert!((found - 500.0 * PI).abs() < 1.5, "{found}");
    for t in part.surface.triangles() {
        let middle = (t.corners[0] + t.corners[1] + t.corners[2]) / 3.0;
        assert!(t.normal.xy().dot(&middle.xy()) > 0.0);
    }
    // Inches become millimetres.
    let inches = text.replace(
        "#1=(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MILLI.,.METRE.));",
        "#1=(CONVERSION_BASED_UNIT('INCH',#8)LENGTH_UNIT()NAMED_UNIT(#7));#7=DIMENSIONAL_EXPONENTS(1.,0.,0.,0.,0.,0.,0.);\
         #8=LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(25.4),#9);#9=(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MILLI.,.METRE.));",
    );
    assert!((area(&inches) / (500.0 * PI * 25.4 * 25.4) - 1.0).abs() < 1e-3);
}

#[test]
fn a_whole_torus_closes_though_it_has_one_vertex() {
    for (ring_mm, tube_mm) in [(30.0, 8.0), (60.0, 15.0)] {
        let mut o = Outline::new(10);
        let round: f64 = ring_mm + tube_mm;
        let point = o.add(&format!("CARTESIAN_POINT('',({round:?},0.,0.))"));
        let vertex = o.add(&format!("VERTEX_POINT('',#{point})"));
        let outer = o.add(&format!("CIRCLE('',#5,{round:?})"));
        let middle = o.add(&format!("CARTESIAN_POINT('',({ring_mm:?},0.,0.))"));
        // About -y, so that the tube's angle rises towards z.
        let axis = o.add("DIRECTION('',(0.,-1.,0.))");
        let frame = o.add(&format!("AXIS2_PLACEMENT_3D('',#{middle},#{axis},#3)"));
        let tube = o.add(&format!("CIRCLE('',#{frame},{tube_mm:?})"));
        let seams = [outer, tube]
            .map(|curve| o.add(&format!("EDGE_CURVE('',#{vertex},#{vertex},#{curve},.T.)")));
        let edges: Vec<String> = [(0, 'T'), (1, 'T'), (0, 'F'), (1, 'F')]
            .iter()
            .map(|(k, sense)| {
                let n = o.add(&format!("ORIENTED_EDGE('',*,*,#{},.{sense}.)", seams[*k]));
                format!("#{n}")
            })
            .collect();
        let border = o.add(&format!("EDGE_LOOP('',({}))", edges.join(",")));
        let bound = o.add(&format!("FACE_OUTER_BOUND('',#{border},.T.)"));
        let text = o.close(
            &format!("TOROIDAL_SURFACE('',#5,{ring_mm:?},{tube_mm:?})"),
            &[bound],
        );
        let part = PartMesh::weld(read(text.as_bytes()).unwrap(), true).unwrap();
        let area = 4.0 * PI * PI * ring_mm * tube_mm;
        let found = part.surface.area_mm2();
        assert!((found / area - 1.0).abs() < 2e-3, "{found} for {area}");
        // Nothing is open, and one handle: V - E + F = 0.
        assert!(
            part.neighbours
                .iter()
                .flatten()
                .all(|n| *n != super::super::weld::BORDER)
        );
        assert_eq!(2 * part.vertices.len(), part.faces.len());
        for t in part.surface.triangles() {
            let middle = (t.corners[0] + t.corners[1] + t.corners[2]) / 3.0;
            let spine = middle.xy().normalize() * ring_mm;
            let out = middle - nalgebra::Vector3::new(spine.x, spine.y, 0.0);
            assert!(t.normal.dot(&out) > 0.9 * out.norm());
        }
    }
}

#[test]
fn what_is_not_read_is_named() {
    for (from, to, words) in [
        (
            "B_SPLINE_SURFACE_WITH_KNOTS",
            "OFFSET_SURFACE",
            "OFFSET_SURFACE",
        ),
        ("EDGE_LOOP", "VERTEX_LOOP", "VERTEX_LOOP"),
        ("= ADVANCED_FACE", "= ORIENTED_FACE", "ORIENTED_FACE"),
        (
            "#6 = PRODUCT_DEFINITION_FORMATION(",
            "#6 = MAPPED_ITEM(",
            "several times",
        ),
        ("LENGTH_UNIT()", "MASS_UNIT()", "unit of length"),
    ] {
        let text = WAVY.replacen(from, to, 1);
        assert_ne!(text, WAVY, "{from}");
        let refused = read(text.as_bytes()).unwrap_err();
        assert_eq!(refused.code, "mesh_format", "{from}");
        assert!(refused.message.contains(words), "{}", refused.message);
    }
    let none = WAVY.replace("OPEN_SHELL", "CLOSED_PATH");
    assert_eq!(read(none.as_bytes()).unwrap().faces.len(), 0);
}

#[test]
fn every_cut_and_every_kind_of_damage_is_named() {
    let bytes = WAVY.as_bytes();
    for cut in (0..bytes.len() - 24).step_by(1511) {
        assert_eq!(
            read(&bytes[..cut]).unwrap_err().code,
            "mesh_unreadable",
            "{cut}"
        );
    }
    // Bytes turned into others, over the whole file: an answer or a name, never a panic.
    let mut seed = 12_345_u64;
    for _ in 0..40 {
        let mut damaged = bytes.to_vec();
        for _ in 0..3 {
            seed = seed
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            let at = (seed >> 33) as usize % damaged.len();
            damaged[at] = b"0123456789.,()#$*-E;'"[(seed >> 20) as usize % 21];
        }
        if let Err(refused) = read(&damaged).and_then(|raw| PartMesh::weld(raw, true)) {
            assert!(refused.code.starts_with("mesh_"), "{}", refused.code);
        }
    }
}

/// An eighth of a ball of 20 mm, by Open CASCADE: its round face reaches the ball's pole.
#[test]
fn the_corner_of_fillets_is_a_piece_of_a_ball() {
    let octant = include_str!("../../../../../../tests/reference/plan/ball_octant.step");
    let wanted = PI * 400.0 / 2.0 + 3.0 * PI * 400.0 / 4.0;
    assert!(
        (area(octant) / wanted - 1.0).abs() < 2e-3,
        "{}",
        area(octant)
    );
    let part = PartMesh::weld(read(octant.as_bytes()).unwrap(), true).unwrap();
    // All looks outwards: the mean of the box lies behind every triangle.
    let inside = nalgebra::Vector3::new(6.0, 6.0, 6.0);
    for t in part.surface.triangles() {
        assert!(t.normal.dot(&(t.corners[0] - inside)) > 0.0);
        for c in t.corners {
            assert!(c.norm() < 20.0 + 1e-6);
        }
    }
}

/// Closed, of one piece, with all triangles within the chord of the ball and looking out of it.
fn lies_on_ball(part: &PartMesh, radius: f64) {
    for t in part.surface.triangles() {
        let middle = (t.corners[0] + t.corners[1] + t.corners[2]) / 3.0;
        assert!(t.normal.dot(&middle) > 0.99 * radius);
        assert!(middle.norm() > radius - super::CHORD_MM - 1e-9 && middle.norm() < radius);
        for c in t.corners {
            assert!((c.norm() - radius).abs() < 1e-9);
        }
    }
    assert_eq!(part.components, 1);
}

/// A whole ball has a point for its border in a file of Open CASCADE's.
#[test]
fn a_whole_ball_is_read_though_its_border_is_a_point() {
    let mut o = Outline::new(10);
    let pole = o.add("CARTESIAN_POINT('',(0.,0.,-12.5))");
    let vertex = o.add(&format!("VERTEX_POINT('',#{pole})"));
    let ring = o.add(&format!("VERTEX_LOOP('',#{vertex})"));
    let bound = o.add(&format!("FACE_BOUND('',#{ring},.T.)"));
    let text = o.close("SPHERICAL_SURFACE('',#5,12.5)", &[bound]);
    let part = PartMesh::weld(read(text.as_bytes()).unwrap(), true).unwrap();
    lies_on_ball(&part, 12.5);
    let border = super::super::weld::BORDER;
    assert!(part.neighbours.iter().flatten().all(|n| *n != border));
    assert_eq!(part.vertices.len() * 2, part.faces.len() + 4);
    let found = part.surface.area_mm2();
    assert!((found / (4.0 * PI * 156.25) - 1.0).abs() < 2e-3, "{found}");
    // Its inner side: the same triangles, turned over.
    assert!(!part.inside_out());
    let (at, _) = text.match_indices(",.T.);").last().unwrap();
    let inner = format!("{},.F.);{}", &text[..at], &text[at + 6..]);
    let inner = PartMesh::weld(read(inner.as_bytes()).unwrap(), true).unwrap();
    assert!(inner.inside_out());
    // A point is no border of another surface.
    let plane = text.replace(
        "SPHERICAL_SURFACE('',#5,12.5)",
        "CYLINDRICAL_SURFACE('',#5,12.5)",
    );
    assert_eq!(read(plane.as_bytes()).unwrap_err().code, "mesh_format");
}

/// More than half of a ball, with a pole in it, and the cap that is left: border circles without a seam.
#[test]
fn a_piece_of_a_ball_that_holds_a_pole_is_read() {
    for (cap, axis) in [(false, "(0.,0.,1.)"), (true, "(0.,0.,-1.)")] {
        let mut o = Outline::new(10);
        // Seen from outside the face is on the left: round the axis upwards for what lies above.
        let middle = o.add("CARTESIAN_POINT('',(0.,0.,-12.))");
        let axis = o.add(&format!("DIRECTION('',{axis})"));
        let frame = o.add(&format!("AXIS2_PLACEMENT_3D('',#{middle},#{axis},#3)"));
        let circle = format!("CIRCLE('',#{frame},16.)");
        let bound = o.ring(&[[16.0, 0.0, -12.0]], &[(circle, true)]);
        let text = o.close("SPHERICAL_SURFACE('',#5,20.)", &[bound]);
        let part = PartMesh::weld(read(text.as_bytes()).unwrap(), true).unwrap();
        lies_on_ball(&part, 20.0);
        let height = if cap { 8.0 } else { 32.0 };
        let wanted = 2.0 * PI * 20.0 * height;
        let found = part.surface.area_mm2();
        assert!((found / wanted - 1.0).abs() < 2e-3, "{found} for {wanted}");
        let above = |t: &crate::surface::Triangle| t.corners.iter().all(|c| c.z > -12.0 - 1e-6);
        assert_eq!(part.surface.triangles().iter().all(above), !cap);
    }
}

/// A ball from pole to pole along its seam, with a round hole across that: what Open CASCADE writes of a drilled ball.
#[test]
fn a_ball_with_a_hole_across_its_seam_is_read() {
    let mut o = Outline::new(10);
    let corners = [
        [0.0, 0.0, -20.0],
        [12.0, 0.0, -16.0],
        [12.0, 0.0, 16.0],
        [0.0, 0.0, 20.0],
    ];
    let vertices = corners.map(|[x, y, z]: [f64; 3]| {
        let point = o.add(&format!("CARTESIAN_POINT('',({x:?},{y:?},{z:?}))"));
        o.add(&format!("VERTEX_POINT('',#{point})"))
    });
    let placed = |o: &mut Outline, at: &str, axis: &str| {
        let at = o.add(&format!("CARTESIAN_POINT('',{at})"));
        let axis = o.add(&format!("DIRECTION('',{axis})"));
        let along = o.add("DIRECTION('',(0.,0.,-1.))");
        o.add(&format!("AXIS2_PLACEMENT_3D('',#{at},#{axis},#{along})"))
    };
    // From the lower pole up along y = 0, and round the hole clockwise as seen from outside.
    let up = placed(&mut o, "(0.,0.,0.)", "(0.,-1.,0.)");
    let round = placed(&mut o, "(12.,0.,0.)", "(-1.,0.,0.)");
    let seam = o.add(&format!("CIRCLE('',#{up},20.)"));
    let hole = o.add(&format!("CIRCLE('',#{round},16.)"));
    let edges =
        [(0, 1, seam), (1, 2, hole), (2, 3, seam), (2, 1, hole)].map(|(from, to, curve)| {
            let (from, to) = (vertices[from], vertices[to]);
            o.add(&format!("EDGE_CURVE('',#{from},#{to},#{curve},.T.)"))
        });
    let gone = [(0, 'T'), (1, 'T'), (2, 'T'), (2, 'F'), (3, 'T'), (0, 'F')];
    let list: Vec<String> = gone
        .iter()
        .map(|(k, sense)| {
            let n = o.add(&format!("ORIENTED_EDGE('',*,*,#{},.{sense}.)", edges[*k]));
            format!("#{n}")
        })
        .collect();
    let ring = o.add(&format!("EDGE_LOOP('',({}))", list.join(",")));
    let bound = o.add(&format!("FACE_OUTER_BOUND('',#{ring},.T.)"));
    let text = o.close("SPHERICAL_SURFACE('',#5,20.)", &[bound]);
    let part = PartMesh::weld(read(text.as_bytes()).unwrap(), true).unwrap();
    lies_on_ball(&part, 20.0);
    let wanted = 2.0 * PI * 20.0 * 32.0;
    let found = part.surface.area_mm2();
    assert!((found / wanted - 1.0).abs() < 2e-3, "{found} for {wanted}");
    // The poles are in it, the hole is not.
    let near = |x: f64, y: f64, z: f64| {
        let at = nalgebra::Vector3::new(x, y, z);
        part.vertices.iter().any(|v| (v - at).norm() < 1.0)
    };
    assert!(near(0.0, 0.0, 20.0) && near(0.0, 0.0, -20.0) && near(-20.0, 0.0, 0.0));
    assert!(!near(20.0, 0.0, 0.0) && !near(16.0, 0.0, 12.0));
}
