//! Reads the reference fits: points, answers and tolerances.

use std::path::PathBuf;

use serde_json::Value;
use umi_core::units::Point;

/// One reference case.
pub struct Case {
    /// Its name, for messages.
    pub id: String,
    /// The whole answer file.
    pub json: Value,
    /// The rows of the points file.
    pub rows: Vec<Vec<f64>>,
}

fn folder() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("reference/fits")
}

fn read(name: &str) -> String {
    let path = folder().join(name);
    std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// The case with this name.
pub fn case(id: &str) -> Case {
    let json: Value = serde_json::from_str(&read(&format!("{id}.json"))).unwrap();
    let csv = read(json["points_csv"].as_str().unwrap());
    let rows = csv
        .lines()
        .skip(1)
        .filter(|line| !line.trim().is_empty())
        .map(|line| line.split(',').map(|x| x.trim().parse().unwrap()).collect())
        .collect();
    Case {
        id: id.to_owned(),
        json,
        rows,
    }
}

/// All cases of the index of these kinds.
pub fn cases(kinds: &[&str]) -> Vec<Case> {
    let index: Value = serde_json::from_str(&read("index.json")).unwrap();
    let cases = index["cases"].as_array().unwrap().iter();
    cases
        .filter(|c| kinds.contains(&c["kind"].as_str().unwrap()))
        .map(|c| case(c["id"].as_str().unwrap()))
        .collect()
}

impl Case {
    /// The points from three columns, the first being `column`.
    pub fn points(&self, column: usize) -> Vec<Point> {
        self.rows
            .iter()
            .map(|row| Point::from_mm(row[column], row[column + 1], row[column + 2]))
            .collect()
    }

    /// The reference value of a result.
    pub fn result(&self, name: &str) -> &Value {
        &self.json["result"][name]
    }

    /// The stated tolerance of a result.
    pub fn tol(&self, name: &str) -> f64 {
        self.json["tol"][name]
            .as_f64()
            .unwrap_or_else(|| panic!("{}: no tol {name}", self.id))
    }

    /// Asserts that numbers agree with the result `name` within `tolerance`.
    pub fn close(&self, name: &str, got: &[f64], tolerance: f64) {
        let wanted = flat(self.result(name));
        assert_eq!(got.len(), wanted.len(), "{} {name}", self.id);
        for (g, w) in got.iter().zip(&wanted) {
            let error = (g - w).abs();
            assert!(
                error <= tolerance,
                "{} {name}: {g} not {w}: {error:e} > {tolerance:e}",
                self.id
            );
        }
    }

    /// As [`Case::close`], at the tolerance that the case states for `name`.
    pub fn close_at_tol(&self, name: &str, got: &[f64]) {
        self.close(name, got, self.tol(name));
    }

    /// Covariances: 1e-6 of the largest element.
    pub fn close_covariance(&self, name: &str, got: &[f64]) {
        let largest = flat(self.result(name))
            .iter()
            .fold(0.0_f64, |m, x| m.max(x.abs()));
        self.close(name, got, 1e-6 * largest);
    }

    /// The same for a covariance with sigma²: given in the reference exactly
    /// where sigma is.
    pub fn close_true_covariance(&self, name: &str, got: Option<Vec<f64>>) {
        assert_eq!(
            got.is_none(),
            self.result(name).is_null(),
            "{} {name}",
            self.id
        );
        if let Some(got) = got {
            self.close_covariance(name, &got);
        }
    }

    /// A direction that is defined up to its sign.
    pub fn close_up_to_sign(&self, name: &str, got: &[f64]) {
        let wanted = flat(self.result(name));
        let dot: f64 = got.iter().zip(&wanted).map(|(a, b)| a * b).sum();
        let same: Vec<f64> = got.iter().map(|x| x * dot.signum()).collect();
        self.close_at_tol(name, &same);
    }

    /// rms, sigma, dof, n and the largest residual.
    pub fn close_statistics(&self, stats: &umi_core::fit::Statistics) {
        let tol = self.tol("rms");
        assert_eq!(
            stats.n as u64,
            self.json["n"].as_u64().unwrap(),
            "{}",
            self.id
        );
        assert_eq!(
            stats.dof as u64,
            self.result("dof").as_u64().unwrap(),
            "{}",
            self.id
        );
        self.close("rms", &[stats.rms.0], tol);
        self.close("max_abs_residual", &[stats.max_abs_residual.0], tol);
        match stats.sigma {
            Some(sigma) => self.close("sigma", &[sigma.0], tol),
            None => assert!(self.result("sigma").is_null(), "{} sigma missing", self.id),
        }
    }

    /// Asserts that a refusal is one of those expected.
    pub fn refused(&self, error: &umi_core::fit::FitError) {
        let classes = self.json["error_any_of"].as_array().unwrap();
        assert!(
            classes.iter().any(|c| c == error.code()),
            "{}: {error:?} {error}",
            self.id
        );
        // A message says what is wrong and what to do.
        assert!(error.to_string().contains(':'), "{}: {error}", self.id);
    }

    /// Whether the case must be refused.
    pub fn expects_error(&self) -> bool {
        self.json["expect"] == "error"
    }

    /// Whether an error is as good as the answer.
    pub fn may_refuse(&self) -> bool {
        self.json["may_refuse"] == true
    }
}

/// All numbers of a value, rows first.
pub fn flat(value: &Value) -> Vec<f64> {
    match value {
        Value::Array(items) => items.iter().flat_map(flat).collect(),
        other => vec![
            other
                .as_f64()
                .unwrap_or_else(|| panic!("no number: {other}")),
        ],
    }
}
