//! Turns the reference data into tables that need no file, text or heap.

use std::error::Error;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::{env, fs};

use serde_json::Value;
use umi_protocol::job::Job;

fn main() -> Result<(), Box<dyn Error>> {
    let house = Path::new("../..");
    let fits = house.join("tests/reference/fits");
    let job = house.join("examples/three-spheres.toml");
    let point = house.join("tests/reference/point");
    println!("cargo::rerun-if-changed={}", fits.display());
    println!("cargo::rerun-if-changed={}", point.display());
    println!("cargo::rerun-if-changed={}", job.display());
    let out = PathBuf::from(env::var_os("OUT_DIR").ok_or("no OUT_DIR")?);

    let index: Value = serde_json::from_str(&fs::read_to_string(fits.join("index.json"))?)?;
    let cases = index["cases"].as_array().ok_or("no cases")?;
    let mut table = String::from("&[\n");
    for case in cases {
        let id = case["id"].as_str().ok_or("no id")?;
        table.push_str(&entry(&fits, id)?);
    }
    let index: Value = serde_json::from_str(&fs::read_to_string(point.join("index.json"))?)?;
    for id in index["cases"].as_array().ok_or("no cases")? {
        table.push_str(&calibration(&point, id.as_str().ok_or("no id")?)?);
    }
    table.push_str("]\n");
    fs::write(out.join("cases.rs"), table)?;

    let job: Job = toml::from_str(&fs::read_to_string(job)?)?;
    fs::write(out.join("job.postcard"), postcard::to_stdvec(&job)?)?;
    Ok(())
}

/// A case as an expression of Rust.
fn entry(fits: &Path, id: &str) -> Result<String, Box<dyn Error>> {
    let case: Value = serde_json::from_str(&fs::read_to_string(fits.join(format!("{id}.json")))?)?;
    let kind = case["kind"].as_str().ok_or("no kind")?;
    let points = case["points_csv"].as_str().ok_or("no points")?;
    let hint: Vec<f64> = match case["hint_axis"].as_array() {
        Some(axis) => axis.iter().filter_map(Value::as_f64).collect(),
        None => vec![0.0; 3],
    };
    let mut text = format!(
        "Case {{ id: {id:?}, kind: {kind:?}, hint: {}, rows: &[",
        row(&hint)
    );
    text.push_str(&rows(&fits.join(points))?);
    text.push_str("] },\n");
    Ok(text)
}

/// A calibration of a point sensor: what is free in its hint, its ball in the first row.
fn calibration(folder: &Path, id: &str) -> Result<String, Box<dyn Error>> {
    let case: Value =
        serde_json::from_str(&fs::read_to_string(folder.join(format!("{id}.json")))?)?;
    let readings = case["readings_csv"].as_str().ok_or("no readings")?;
    let spheres = case["spheres"].as_str().ok_or("no spheres")?;
    let spheres: toml::Table = toml::from_str(&fs::read_to_string(folder.join(spheres))?)?;
    let sphere = spheres["sphere"].get(0).ok_or("no sphere")?;
    let number = |key: &str| sphere.get(key).and_then(toml::Value::as_float);
    let center = sphere["center_mm"].as_array().ok_or("no centre")?;
    let mut ball: Vec<f64> = center.iter().filter_map(toml::Value::as_float).collect();
    ball.push(number("radius_mm").ok_or("no radius")?);
    ball.push(number("u_center_mm").unwrap_or(0.0));
    ball.push(number("u_radius_mm").unwrap_or(0.0));
    let free = case["free"].as_array().ok_or("no free")?;
    let is_free = |name: &str| f64::from(u8::from(free.contains(&name.into())));
    let hint = [is_free("radius"), is_free("gain"), 0.0];
    Ok(format!(
        "Case {{ id: {id:?}, kind: \"point_sensor\", hint: {}, rows: &[{}, {}] }},\n",
        row(&hint),
        row(&ball),
        rows(&folder.join(readings))?
    ))
}

/// The rows of a table behind its head, filled up to six columns.
fn rows(path: &Path) -> Result<String, Box<dyn Error>> {
    let mut text = String::new();
    for line in fs::read_to_string(path)?.lines().skip(1) {
        if line.trim().is_empty() {
            continue;
        }
        let values: Result<Vec<f64>, _> =
            line.split(',').map(|value| value.trim().parse()).collect();
        let mut values = values?;
        values.resize(6, 0.0);
        write!(text, "{}, ", row(&values))?;
    }
    Ok(text)
}

/// Numbers to the last bit.
fn row(values: &[f64]) -> String {
    let bits: Vec<String> = values
        .iter()
        .map(|value| format!("f64::from_bits({:#x})", value.to_bits()))
        .collect();
    format!("[{}]", bits.join(", "))
}
