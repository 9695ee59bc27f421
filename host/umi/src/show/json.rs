//! Results as JSON for machines: the one place that knows the fields.
//!
//! * A number is the shortest decimal that reads back as the same double; one
//!   that is not finite is null.
//! * A name says its unit: `_mm`, `_deg`, `_rad`, `_us`, `_mm2`, `_rad2`.
//! * What does not apply is null; a field is never missing.
//! * Residuals, sigma and covariances are defined as in
//!   `tests/reference/fits/README.md`. `cov_unit…` is for noise of 1 mm, `cov…`
//!   for the noise that was found, `u_…` is a standard uncertainty.

use serde::Serialize;
use serde_json::{Map, Value, json};
use umi_core::registration::Distance;
use umi_protocol::access::{AccessMode, KeyId};
use umi_protocol::fault::{Counters, Fault, FaultCode};
use umi_protocol::feature::FeatureResult;
use umi_protocol::latch::{LatchCause, LatchReport, Positions};
use umi_protocol::line::{HitReport, LineReport};
use umi_protocol::message::{Identity, JournalInfo, Record, Status};
use umi_protocol::reason::Reason;
use umi_protocol::update::ImageInfo;
use umi_protocol::verdict::{CorrectionReport, DistanceReport, SetupReason, Verdict};

use umi_client::axes::Scale;
use umi_client::files::image_file::version_text;
use umi_client::quantities::{Amount, FitFigures, Registered, Rows, Spread, parameters};
use umi_client::session::DecisionRecord;
use umi_client::timeline::{Loss, Lost};
use umi_protocol::feature::Shape;

/// What the board decided.
#[must_use]
pub fn decision(decision: &DecisionRecord) -> Value {
    match decision {
        DecisionRecord::Feature(of) => feature(of),
        DecisionRecord::Verdict(of) => verdict(of),
        DecisionRecord::Fault(of) => fault(of),
    }
}

/// A fit: what `umi fit --json` prints.
#[must_use]
pub fn fit(fit: &FitFigures<'_>) -> Value {
    let (parameters, spreads) = parameters(&fit.shape);
    let mut object = Map::new();
    let mut put = |name: String, value: Value| object.insert(name, value);
    put("kind".into(), fit.kind().into());
    put("n".into(), fit.residuals_mm.len().into());
    for p in &parameters {
        put(format!("{}{}", p.name, p.unit.suffix()), amount(&p.value));
    }
    put("rms_mm".into(), fit.rms_mm.into());
    put("sigma_mm".into(), fit.sigma_mm.into());
    put("dof".into(), fit.dof.into());
    let worst = fit.worst().map(|(_, d)| d);
    put("max_abs_residual_mm".into(), worst.into());
    if let Shape::Circle { rms_plane_mm, .. } = fit.shape {
        put("rms_plane_mm".into(), rms_plane_mm.into());
    }
    for p in &parameters {
        if let Some((of, _)) = p.uncertainty {
            let u = p.standard_uncertainty(fit.sigma_mm);
            let u = u.map_or(Value::Null, |u| amount(&u));
            put(format!("u_{of}{}", p.unit.suffix()), u);
        }
    }
    for spread in &spreads {
        let (unit_name, name) = spread_names(spread);
        put(unit_name, rows(&spread.rows, 1.0));
        let variance = fit.sigma_mm.map(|sigma| sigma * sigma);
        put(
            name,
            variance.map_or(Value::Null, |v| rows(&spread.rows, v)),
        );
    }
    put("residuals_mm".into(), json!(fit.residuals_mm));
    Value::Object(object)
}

/// The same of a cloud: with how many of its points were left out, because they have no numbers.
#[must_use]
pub fn fit_of_cloud(of: &FitFigures<'_>, not_finite: u64) -> Value {
    let mut value = fit(of);
    if let Some(object) = value.as_object_mut() {
        object.insert("not_finite".into(), not_finite.into());
    }
    value
}

fn spread_names(spread: &Spread) -> (String, String) {
    let kind = match spread.rows {
        Rows::One(_) => "var",
        Rows::Matrix(_) => "cov",
    };
    let of = match spread.of {
        "" => String::new(),
        of => format!("_{of}"),
    };
    let square = spread.unit.square_suffix();
    (format!("{kind}_unit{of}"), format!("{kind}{of}{square}"))
}

fn amount(amount: &Amount) -> Value {
    match amount {
        Amount::Scalar(value) => json!(value),
        Amount::Vector(values) => json!(values),
    }
}

fn rows(rows: &Rows, factor: f64) -> Value {
    match rows {
        Rows::One(value) => json!(value * factor),
        Rows::Matrix(rows) => rows
            .iter()
            .map(|row| row.iter().map(|x| x * factor).collect::<Vec<f64>>())
            .collect(),
    }
}

/// A registration: what `umi register --json` prints, but for the distances.
#[must_use]
pub fn registration(result: &Registered<'_>) -> Value {
    let variance = result.sigma_mm.map(|sigma| sigma * sigma);
    let cov = |unit: &[[f64; 3]; 3]| variance.map(|v| unit.map(|row| row.map(|x| x * v)));
    json!({
        "kind": "registration",
        "n": result.residuals_mm.len(),
        "rotation": result.rotation,
        "translation_mm": result.translation_mm,
        "angle_deg": result.angle_deg,
        "axis": result.axis,
        "rms_mm": result.rms_mm,
        "sigma_mm": result.sigma_mm,
        "dof": result.dof,
        "max_abs_residual_mm": result.worst().map(|(_, d)| d),
        "u_rotvec_rad": result.u_rotvec_rad(),
        "u_translation_mm": result.u_translation_mm(),
        "cov_unit_rotvec": result.cov_unit_rotvec,
        "cov_rotvec_rad2": cov(&result.cov_unit_rotvec),
        "cov_unit_t": result.cov_unit_t,
        "cov_t_mm2": cov(&result.cov_unit_t),
        "expected_error_mm": result.expected_error_mm,
        "residuals_mm": result.residuals_mm,
    })
}

/// A distance between two points of a registration, by their numbers from 1.
#[must_use]
pub fn distance(distance: &Distance) -> Value {
    json!({
        "a": distance.first + 1,
        "b": distance.second + 1,
        "measured_mm": distance.measured.0,
        "reference_mm": distance.nominal.0,
        "error_mm": distance.difference().0,
    })
}

/// A feature as an event.
#[must_use]
pub fn feature(result: &FeatureResult) -> Value {
    json!({
        "type": "feature",
        "index": result.index,
        "plate": result.setup,
        "name": result.name,
        "kind": result.kind,
        "status": if result.is_ok() { "ok" } else { "refused" },
        "reasons": result.reasons.iter().map(reason).collect::<Vec<_>>(),
        "points_mm": result.points_mm,
        "fit": result.fit.as_ref().map(|report| fit(&report.into())),
    })
}

/// A reason of a feature.
#[must_use]
pub fn reason(reason: &Reason) -> Value {
    json!({
        "code": reason.code(),
        "message": reason.to_string(),
        "details": figures(reason),
    })
}

/// A reason or remark of a verdict.
#[must_use]
pub fn setup_reason(of: &SetupReason) -> Value {
    json!({
        "code": of.reason.code(),
        "feature": of.feature,
        "message": of.reason.to_string(),
        "details": figures(&of.reason),
    })
}

/// A fault as an event.
#[must_use]
pub fn fault(fault: &Fault) -> Value {
    json!({
        "type": "fault",
        "code": fault.code().as_str(),
        "line": fault.line,
        "byte_offset": fault.byte_offset,
        "t_us": fault.t_us,
        "text": fault.text,
        "message": fault.kind.to_string(),
        "details": figures(&fault.kind),
    })
}

/// A verdict as an event.
#[must_use]
pub fn verdict(verdict: &Verdict) -> Value {
    let list = |reasons: &[SetupReason]| reasons.iter().map(setup_reason).collect::<Vec<_>>();
    json!({
        "type": "verdict",
        "plate": verdict.setup,
        "verdict": if verdict.ok { "OK" } else { "NG" },
        "reasons": list(&verdict.reasons),
        "reasons_dropped": verdict.reasons_dropped,
        "remarks": list(&verdict.remarks),
        "distances": verdict.distances.iter().map(plate_distance).collect::<Vec<_>>(),
        "registration": verdict.registration.as_ref().map(|report| registration(&report.into())),
        "correction": verdict.correction.as_ref().map(correction),
    })
}

fn plate_distance(distance: &DistanceReport) -> Value {
    json!({
        "a": distance.a,
        "b": distance.b,
        "measured_mm": distance.measured_mm,
        "reference_mm": distance.reference_mm,
        "error_mm": distance.reference_mm.map(|reference| distance.measured_mm - reference),
    })
}

fn correction(correction: &CorrectionReport) -> Value {
    json!({
        "dialect": correction.dialect.name(),
        "text": correction.text,
        "leftover_mm": correction.leftover_mm,
    })
}

/// A line from the control as an event.
#[must_use]
pub fn line(line: &LineReport) -> Value {
    json!({
        "type": "line",
        "line": line.number,
        "byte_offset": line.byte_offset,
        "t_us": line.t_us,
        "status": line.status,
        "text": line.text,
    })
}

/// A hit as an event.
#[must_use]
pub fn hit(hit: &HitReport) -> Value {
    let mut value = tagged("hit");
    value.extend(object(hit));
    Value::Object(value)
}

/// A latch as an event; its position where the scale is known.
#[must_use]
pub fn latch(latch: &LatchReport, scale: &Scale) -> Value {
    let mut object = object(latch);
    let mm = scale.position_mm(&latch.counts);
    object.insert("cause".into(), cause(latch.cause));
    object.insert("axis".into(), axis(latch.cause));
    object.insert("position_mm".into(), some(mm));
    object.insert("type".into(), "latch".into());
    Value::Object(object)
}

/// A list, or null if there is nothing in it.
fn some(list: Vec<f64>) -> Value {
    if list.is_empty() {
        Value::Null
    } else {
        list.into()
    }
}

/// What caused a latch.
#[must_use]
fn cause(cause: LatchCause) -> Value {
    variant(&cause).0.into()
}

fn axis(cause: LatchCause) -> Value {
    match cause {
        LatchCause::Index { axis } => axis.into(),
        _ => Value::Null,
    }
}

/// Something that is missing, as an event.
#[must_use]
pub fn loss(loss: &Loss) -> Value {
    let (of, first) = match loss.what {
        Lost::Edges(of) => (Some(of), None),
        Lost::Latches(of, first) => (Some(of), Some(first)),
        Lost::Counted | Lost::Events | Lost::Bytes | Lost::Motion | Lost::Transitions => {
            (None, None)
        }
    };
    json!({
        "type": "loss",
        "what": loss.what.code(),
        "count": loss.count,
        "cause": of.map(cause),
        "axis": of.map(axis),
        "first_number": first,
        "t_ns": loss.t_ns,
    })
}

/// Where the axes are and what they counted wrong.
#[must_use]
pub fn positions(positions: &Positions, scale: &Scale) -> Value {
    let mut object = object(positions);
    let mm = scale.position_mm(&positions.counts);
    object.insert("position_mm".into(), some(mm));
    object.insert("valid".into(), positions.are_valid().into());
    object.insert("origin_known".into(), scale.has_origin().into());
    Value::Object(object)
}

/// A journal entry as an event: the record's own fields behind `seq` and `t_us`.
#[must_use]
pub fn entry(seq: u64, t_us: u64, of: &Record) -> Value {
    let mut object = Map::new();
    object.insert("seq".into(), seq.into());
    object.insert("t_us".into(), t_us.into());
    if let Value::Object(fields) = record(of) {
        for (name, value) in fields {
            // A fault has a time of its own, that of the line: the entry's goes first.
            object.entry(name).or_insert(value);
        }
    }
    Value::Object(object)
}

/// As [`entry`], and with a verdict who may do what with the board that reached it.
#[must_use]
pub fn guarded_entry(seq: u64, t_us: u64, of: &Record, mode: Option<AccessMode>) -> Value {
    let mut value = entry(seq, t_us, of);
    if let Record::Verdict(_) = of {
        value["access"] = json!(mode);
    }
    value
}

/// A record's fields behind its type, by the names that they have on the wire.
fn record(record: &Record) -> Value {
    let why = match record {
        Record::Fault(of) => return fault(of),
        Record::FaultsAgain { latest, count } => {
            let mut of = fault(latest);
            of["count"] = (*count).into();
            return of;
        }
        Record::Feature(of) => return feature(of),
        Record::Verdict(of) => return verdict(of),
        Record::Latch(of) => return latch(of, &Scale::default()),
        Record::Head(of) => {
            let mut object = tagged("head");
            if let Value::Object(fields) = umi_client::files::head_file::json(of) {
                // The entry has its own number and time.
                let fields = fields
                    .into_iter()
                    .filter(|(name, _)| name != "seq" && name != "t_us");
                object.extend(fields);
            }
            return Value::Object(object);
        }
        // `seq` is the entry's own.
        Record::Acknowledged { seq, lost } => {
            return json!({"type": "acknowledged", "acked_seq": seq, "lost": lost});
        }
        Record::JobSet { job, key_id } => {
            return json!({"type": "job_set", "job": job, "key_id": id(key_id.as_ref())});
        }
        Record::ProgramDeleted {
            number,
            crc32,
            key_id,
        } => {
            return json!({
                "type": "program_deleted",
                "number": number,
                "crc32": crc32,
                "key_id": id(key_id.as_ref()),
            });
        }
        Record::Access {
            what,
            key_id,
            role,
            by,
        } => {
            return json!({
                "type": "access",
                "what": what,
                "key_id": id(Some(key_id)),
                "role": role,
                "by": id(by.as_ref()),
            });
        }
        Record::AccessRefused { why, count, key_id } => {
            return json!({
                "type": "access_refused",
                "why": why.code(),
                "count": count,
                "key_id": id(key_id.as_ref()),
                "message": why.to_string(),
            });
        }
        Record::Wiped {
            first_seq,
            next_seq,
            chain,
            key_id,
        } => {
            return json!({
                "type": "wiped",
                "first_seq": first_seq,
                "next_seq": next_seq,
                "chain": umi_client::journal::hex(chain),
                "key_id": id(key_id.as_ref()),
            });
        }
        Record::Update { what, from, to } => {
            return json!({
                "type": "update",
                "what": what,
                "from": version_text(*from),
                "to": version_text(*to),
            });
        }
        Record::HostTime { utc_s, key_id } => {
            return json!({
                "type": "host_time",
                "utc_s": utc_s,
                "utc": crate::show::utc::utc(*utc_s),
                "key_id": id(key_id.as_ref()),
            });
        }
        Record::SensorSet { sensor, key_id } => {
            return json!({
                "type": "sensor_set",
                "sensor": sensor,
                "key_id": id(key_id.as_ref()),
            });
        }
        Record::Place(place) => return super::sensor::place_json(place),
        Record::CaptureLost(loss) => return super::sensor::loss_json(loss),
        Record::ReferenceRestored { positions_mm, .. } => {
            return json!({"type": "reference_restored", "positions_mm": positions_mm});
        }
        Record::Bytes { raw } => {
            return json!({
                "type": "bytes",
                "text": crate::show::text::printable(raw),
                "hex": raw.iter().map(|byte| format!("{byte:02x}")).collect::<String>(),
            });
        }
        Record::Scan(scan) => {
            let mut object = object(scan);
            object.insert("cause".into(), cause(scan.cause));
            object.insert("type".into(), "scan".into());
            return Value::Object(object);
        }
        Record::ProgramKept { program, key_id } => {
            let mut object = object(program);
            object.insert("key_id".into(), id(key_id.as_ref()));
            object.insert("type".into(), "program_kept".into());
            return Value::Object(object);
        }
        Record::AlarmSent { why, .. } => (why.code(), why.to_string()),
        Record::JobLost { why } => (why.code(), why.to_string()),
        Record::ProgramNotKept { why, .. } => (why.code(), why.to_string()),
        _ => ("", String::new()),
    };
    let (name, fields) = variant(record);
    let mut object = tagged(&name);
    let fields = fields.as_object().cloned().unwrap_or_default();
    for (name, value) in fields {
        match name.as_str() {
            "why" => {
                object.insert("code".into(), why.0.into());
                object.insert("message".into(), why.1.clone().into());
                continue;
            }
            "setup" => object.insert("plate".into(), value),
            "rewritten_for" => object.insert("rewritten_for_plate".into(), value),
            "reset" => object.insert(name, variant(&value).0.into()),
            _ => object.insert(name, value),
        };
    }
    Value::Object(object)
}

/// The short name of a key; null: nobody's.
fn id(key_id: Option<&KeyId>) -> Value {
    key_id.map(|id| umi_client::journal::hex(id)).into()
}

/// Who a board is.
#[must_use]
pub fn identity(identity: &Identity) -> Value {
    Value::Object(object(identity))
}

/// What a board does and what it has counted.
#[must_use]
pub fn status(status: &Status) -> Value {
    let mut object = object(status);
    object.insert("reset".into(), variant(&status.reset).0.into());
    object.insert("counters".into(), counters(&status.counters));
    Value::Object(object)
}

/// The receiver's counters; faults by their name.
#[must_use]
pub fn counters(counters: &Counters) -> Value {
    let mut object = object(counters);
    let faults: Map<String, Value> = FaultCode::ALL
        .iter()
        .map(|&code| (code.as_str().to_owned(), counters.of(code).into()))
        .collect();
    object.insert("faults".into(), Value::Object(faults));
    Value::Object(object)
}

/// The image that a board runs.
#[must_use]
pub fn image(image: &ImageInfo) -> Value {
    json!({
        "version": version_text(image.version),
        "counter": image.counter,
        "slot": image.place,
        "confirmed": image.confirmed,
        "sha512": image.sha512.map(|halves| umi_client::journal::hex(&halves.concat())),
    })
}

/// What a journal holds.
#[must_use]
pub fn journal_info(info: &JournalInfo) -> Value {
    Value::Object(object(info))
}

/// An event of this type, still without fields.
fn tagged(of: &str) -> Map<String, Value> {
    Map::from_iter([("type".into(), of.into())])
}

/// The fields of a value, by the names that they have on the wire.
fn object(value: &impl Serialize) -> Map<String, Value> {
    match serde_json::to_value(value) {
        Ok(Value::Object(object)) => object,
        _ => Map::new(),
    }
}

/// The figures of a reason or fault, without its name.
fn figures(value: &impl Serialize) -> Value {
    variant(value).1
}

/// The name of a variant, as `power_on` for `PowerOn`, and its fields.
fn variant(value: &impl Serialize) -> (String, Value) {
    let (name, fields) = match serde_json::to_value(value) {
        Ok(Value::String(name)) => (name, json!({})),
        // serde writes a variant with fields as {"Name": {…}}.
        Ok(Value::Object(object)) => object.into_iter().next().unwrap_or_default(),
        _ => (String::new(), json!({})),
    };
    let mut snake = String::new();
    for letter in name.chars() {
        if letter.is_uppercase() && !snake.is_empty() {
            snake.push('_');
        }
        snake.extend(letter.to_lowercase());
    }
    (snake, fields)
}

#[cfg(test)]
mod tests;
