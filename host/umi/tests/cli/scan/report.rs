//! `umi scan report`: the page holds the figures of `compare`, and a browser draws its points.

use std::fmt::Write as _;
use std::process::{Command, Stdio};

use serde_json::{Value, json};

use crate::rig::run::{Folder, umi};

const BALL: &str = "kind = \"sphere\"\ncenter_mm = [100, 0, 0]\nradius_mm = 12.7\n";

/// Points on a ball of 12.7 mm, some 0.06 mm outside of it and some 0.03 mm inside.
fn ball(folder: &Folder) -> (String, String) {
    let mut text = String::from("x_mm,y_mm,z_mm\n");
    for i in 0..120 {
        for j in 0..60 {
            let (a, b) = (f64::from(i) * 0.0523, f64::from(j) * 0.0523);
            let off = match (i, j) {
                (10..20, 20..30) => 0.06,
                (60..90, _) => -0.03,
                _ => 0.0,
            };
            let r = 12.7 + off;
            let (x, y) = (100.0 + r * b.sin() * a.cos(), r * b.sin() * a.sin());
            writeln!(text, "{x:.6},{y:.6},{:.6}", r * b.cos()).unwrap();
        }
    }
    (
        folder.file("ball.csv", text),
        folder.file("ball.toml", BALL),
    )
}

#[test]
fn the_page_has_maps_sections_figures_and_what_was_lost() {
    let folder = Folder::new();
    let (cloud, nominal) = ball(&folder);
    let merge = json!({
        "pairs": [{"profile": 0, "frame": 7, "number": 0}, {"profile": 1, "frame": 10, "number": 1}],
        "unpaired_profiles": [], "duplicates": [2], "unpaired_triggers": [], "lost_frames": 2,
        "missed_latches": 0, "clock": {"offset_us": 0.0, "drift_ppm": 0.0}, "warnings": ["odd <b>"],
        "profiles": 3, "paired": 2, "points": 7200, "invalid": 0, "bounds_mm": null});
    let merge = folder.file("merge.json", merge.to_string());
    let page = folder.path("page.html");
    let args = [
        "scan",
        "report",
        &cloud,
        "--nominal",
        &nominal,
        "-o",
        &page,
        "--json",
    ];
    let more = [
        "--limits",
        "-0.05,0.05",
        "--merge",
        &merge,
        "--section",
        "z=2",
    ];
    let told = umi(&[&args[..], &more].concat()).exits(0).json();
    let compared = umi(&["scan", "compare", &cloud, "--nominal", &nominal, "--json"])
        .exits(0)
        .json();
    for (name, value) in compared.as_object().unwrap() {
        let (a, b) = (told[name].as_f64().unwrap(), value.as_f64().unwrap());
        assert!((a - b).abs() < 1e-12, "{name}");
    }
    assert_eq!(told["above"], 100);
    assert_eq!(told["below"], 0);
    assert_eq!(told["lost_frames"], 2);
    let html = std::fs::read_to_string(&page).unwrap();
    for text in [
        "100 of 7200 points (1.39 %) lie outside",
        "From above",
        "From below",
        "Section Z = 2.000 mm",
        "upper limit",
        "Frames lost: 2",
        "odd &lt;b&gt;",
        "script-src &#39;sha256-",
        "default-src &#39;none&#39;",
    ] {
        assert!(html.contains(text), "{text}");
    }
    for other in ["src=", "href=", "http://", "https://", "NaN"] {
        let found = html.replace("http://www.w3.org/2000/svg", "");
        assert!(!found.contains(other), "{other}");
    }
    assert_eq!(html.matches("<script").count(), 1);
    // A page that is there is not replaced by chance, and not by what it is made of.
    umi(&args[..7]).exits(1).says("is there already");
    umi(&[&args[..7], &["--force"]].concat()).exits(0);
    let html = std::fs::read_to_string(&page).unwrap();
    assert!(html.contains("no limits were given") && !html.contains("upper limit"));
}

#[test]
fn what_makes_no_page_leaves_none() {
    let folder = Folder::new();
    let (cloud, nominal) = ball(&folder);
    let empty = folder.file("empty.csv", "x_mm,y_mm,z_mm\n");
    let holed = folder.file("holed.csv", "x_mm,y_mm,z_mm\n1,2,nan\n");
    let other = folder.file("other.json", "{\"kind\":\"scan_plan\"}");
    let page = folder.path("page.html");
    for (cloud, nominal, more, status, code) in [
        (&empty, &nominal, vec![], 2, "too_few_points"),
        (&holed, &nominal, vec![], 2, "not_finite"),
        (&cloud, &cloud, vec![], 1, "nominal"),
        (&cloud, &nominal, vec!["--merge", &other], 1, "bad_file"),
    ] {
        let mut args = vec!["scan", "report", cloud, "--nominal", nominal];
        args.extend(["-o", &page, "--json"]);
        args.extend(more);
        let ran = umi(&args).exits(status);
        assert_eq!(ran.json()["error"]["code"], code);
        assert!(!std::path::Path::new(&page).exists());
    }
    for limits in ["0.05,-0.05", "1", "a,b", "nan,1"] {
        umi(&[
            "scan",
            "report",
            &cloud,
            "--nominal",
            &nominal,
            "-o",
            &page,
            "--limits",
            limits,
        ])
        .exits(1);
    }
}

/// A browser compiles the shaders and draws every point, where there is one: `UMI_BROWSER` is its
/// name, as `cargo xtask test` finds it.
#[test]
fn a_browser_draws_the_points() {
    let Some(browser) = std::env::var_os("UMI_BROWSER") else {
        return;
    };
    let folder = Folder::new();
    let (cloud, nominal) = ball(&folder);
    let page = folder.path("page.html");
    umi(&["scan", "report", &cloud, "--nominal", &nominal, "-o", &page]).exits(0);
    let dom = |turn: &str| {
        let output = Command::new(&browser)
            .args([
                "--headless",
                "--no-sandbox",
                "--disable-gpu-sandbox",
                "--use-gl=angle",
            ])
            .args([
                "--use-angle=swiftshader",
                "--enable-unsafe-swiftshader",
                "--dump-dom",
            ])
            .arg(format!("--user-data-dir={}", folder.path("browser")))
            .arg(format!("file://{page}{turn}"))
            .stdin(Stdio::null())
            .output()
            .unwrap();
        String::from_utf8(output.stdout).unwrap()
    };
    let value = |dom: &str, name: &str| -> Option<Value> {
        let from = dom.split_once(&format!("data-{name}=\""))?.1;
        Some(Value::from(from.split_once('"')?.0))
    };
    for (turn, angles) in [("", "-30.0,-60.0"), ("#turn=10,-80", "10.0,-80.0")] {
        let dom = dom(turn);
        assert_eq!(value(&dom, "state"), Some("drawn".into()), "{:.600}", dom);
        assert_eq!(value(&dom, "drawn"), Some("7200".into()));
        assert_eq!(value(&dom, "turn"), Some(angles.into()));
        // A ball fills some of the picture, and not all of it.
        let lit: f64 = value(&dom, "lit")
            .unwrap()
            .as_str()
            .unwrap()
            .parse()
            .unwrap();
        assert!(lit > 0.05 && lit < 0.6, "{lit}");
    }
}
