//! The sentence and the code of everything that can be wrong.
//!
//! People script against the codes and look the sentences up, so a change of either must be
//! seen by the one who makes it: `sentences.txt` holds both for every variant.

use std::fmt::{Display, Write as _};

use serde::de::DeserializeOwned;
use umi_protocol::Schema;
use umi_protocol::fault::{BlockEndCause, FaultCode, FaultKind, NumberIssue};
use umi_protocol::job_error::{Field, JobError};
use umi_protocol::message::{JobLoss, LineRefusal, TeachRefusal};
use umi_protocol::point_sensor::SensorRefusal;
use umi_protocol::program::{ProgramRefusal, Withheld};
use umi_protocol::reason::{FitRefusal, Reason};
use umi_protocol::update::UpdateRefusal;

use super::hold;
use super::schema_and_serde::every_variant;

/// One line for every variant of a type, however deep: code and sentence.
fn page<T: Schema + DeserializeOwned + Display>(text: &mut String, code: impl Fn(&T) -> String) {
    writeln!(text, "# {}", T::SCHEMA.name).unwrap();
    for bytes in every_variant(T::SCHEMA, &mut 0) {
        let value: T = postcard::from_bytes(&bytes).unwrap();
        let sentence = value.to_string();
        writeln!(text, "{}: {}", code(&value), sentence.escape_debug()).unwrap();
    }
}

#[test]
fn codes_and_sentences_stay() {
    let mut text = String::new();
    page::<Reason>(&mut text, |it| it.code().into());
    page::<FitRefusal>(&mut text, |it| it.code().into());
    page::<FaultKind>(&mut text, |it| it.code().as_str().into());
    page::<FaultCode>(&mut text, |it| it.as_str().into());
    page::<NumberIssue>(&mut text, |_| String::new());
    page::<BlockEndCause>(&mut text, |_| String::new());
    page::<JobError>(&mut text, |it| it.code().into());
    page::<SensorRefusal>(&mut text, |it| it.code().into());
    page::<Withheld>(&mut text, |it| format!("{} ({})", it.code(), it.alarm()));
    page::<ProgramRefusal>(&mut text, |it| it.code().into());
    page::<TeachRefusal>(&mut text, |it| it.code().into());
    page::<JobLoss>(&mut text, |it| it.code().into());
    page::<LineRefusal>(&mut text, |it| it.code().into());
    page::<UpdateRefusal>(&mut text, |it| it.code().into());
    writeln!(text, "# Field").unwrap();
    for bytes in every_variant(Field::SCHEMA, &mut 0) {
        let field: Field = postcard::from_bytes(&bytes).unwrap();
        writeln!(text, "{}", field.name()).unwrap();
    }
    let reversed = Reason::WitnessScale { axis: 1, ppm: -2e6 };
    writeln!(text, "# counts the other way\n{reversed}").unwrap();
    hold("sentences.txt", &text);
}
