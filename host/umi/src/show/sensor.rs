//! What the station of a distance sensor tells.

use crate::show::terminal::Plain;
use serde_json::{Value, json};
use umi_protocol::point_sensor::{CaptureLoss, CommandFault, PlaceReport};

/// A place as the journal's object.
pub fn place_json(place: &PlaceReport) -> Value {
    json!({
        "type": "place",
        "number": place.number,
        "status": place.state.code(),
        "axes_mm": place.axes_mm,
        "gamma_mm": place.gamma_mm,
        "spread_mm": place.spread_mm,
        "captures": place.captures,
        "outliers": place.outliers,
        "lost": place.lost,
        "snr": place.snr,
        "total": place.total,
        "point_mm": place.point_mm,
    })
}

/// What was lost as the journal's object.
pub fn loss_json(loss: &CaptureLoss) -> Value {
    let (what, number) = match loss {
        CaptureLoss::Latch { latch } => ("latch", Some(*latch)),
        CaptureLoss::Reading { reading } => ("reading", Some(*reading)),
        CaptureLoss::Text => ("text", None),
        CaptureLoss::Characters { count } => ("characters", Some(*count)),
        CaptureLoss::Command(_) => ("command", None),
        CaptureLoss::Records { count } => ("records", Some(*count)),
        CaptureLoss::Setup(_) => ("setup", None),
    };
    json!({
        "type": "capture_lost",
        "what": what,
        "number": number,
        "code": match loss {
            CaptureLoss::Command(fault) => Some(fault.code()),
            CaptureLoss::Setup(why) => Some(why.code()),
            _ => None,
        },
        "message": loss_text(loss),
    })
}

/// A place in a line.
pub fn place_text(place: &PlaceReport) -> String {
    match place.point_mm {
        Some([x, y, z]) => format!(
            "place {}: X {:.4} Y {:.4} Z {:.4} from {} captures, reading {:.4} mm",
            place.number,
            Plain(x),
            Plain(y),
            Plain(z),
            place.captures,
            place.gamma_mm
        ),
        None => format!("place {}: no point, {}", place.number, place.state.code()),
    }
}

/// What was lost, in a line.
pub fn loss_text(loss: &CaptureLoss) -> String {
    match loss {
        CaptureLoss::Latch { latch } => format!("capture {latch} of the sensor has no reading"),
        CaptureLoss::Reading { reading } => {
            format!("reading {reading} of the sensor belongs to no capture")
        }
        CaptureLoss::Text => "a line of the sensor is no reading".to_owned(),
        CaptureLoss::Characters { count } => {
            format!("{count} characters of the sensor were lost")
        }
        CaptureLoss::Command(fault) => {
            let why = match fault {
                CommandFault::Unreadable => "it is not written as one",
                CommandFault::CheckValue => "its check value is another one, so it was damaged",
                CommandFault::Value => {
                    "there is none such, K1 did not come before it, its values are beyond the sensor's, or the board cannot \
                     send its capture pulses, as one without encoders"
                }
            };
            format!("a command to the sensor's station was not carried out: {why}")
        }
        CaptureLoss::Records { count } => {
            format!("{count} entries of the sensor's station found no room")
        }
        CaptureLoss::Setup(why) => format!("no sensor is in force: {why}"),
    }
}
