//! The layout of types as text: each type once, in the order of first use.

use std::collections::VecDeque;
use std::fmt::Write as _;

use umi_protocol::schema::{DataModelType, DataModelVariant, NamedType, NamedValue};

/// The layout of these types and of all that they contain.
pub fn text(types: &[&'static NamedType]) -> String {
    let mut out = String::new();
    let mut due: VecDeque<&'static NamedType> = types.iter().copied().collect();
    let mut known: Vec<&'static NamedType> = types.to_vec();
    while let Some(of) = due.pop_front() {
        let mut used = Vec::new();
        writeln!(out, "{}", of.name).unwrap();
        match of.ty {
            DataModelType::Struct(fields) => {
                for field in *fields {
                    writeln!(out, "    {}", value(field, &mut used)).unwrap();
                }
            }
            DataModelType::Enum(variants) => {
                for (number, variant) in variants.iter().enumerate() {
                    let content = match variant.ty {
                        DataModelVariant::UnitVariant => String::new(),
                        DataModelVariant::NewtypeVariant(inner) => {
                            format!(" ({})", name(inner, &mut used))
                        }
                        DataModelVariant::TupleVariant(inner) => {
                            let names: Vec<String> =
                                inner.iter().map(|of| name(of, &mut used)).collect();
                            format!(" ({})", names.join(", "))
                        }
                        DataModelVariant::StructVariant(fields) => {
                            let values: Vec<String> =
                                fields.iter().map(|field| value(field, &mut used)).collect();
                            format!(" {{ {} }}", values.join(", "))
                        }
                    };
                    writeln!(out, "    {number} {}{content}", variant.name).unwrap();
                }
            }
            other => panic!("{} is neither struct nor enum: {other:?}", of.name),
        }
        for of in used {
            match known.iter().find(|other| other.name == of.name) {
                Some(other) => assert_eq!(*other, of, "two types named {}", of.name),
                None => {
                    known.push(of);
                    due.push_back(of);
                }
            }
        }
    }
    out
}

fn value(field: &NamedValue, used: &mut Vec<&'static NamedType>) -> String {
    format!("{}: {}", field.name, name(field.ty, used))
}

/// The name of a type; structs and enums in it are added to `used`.
fn name(of: &'static NamedType, used: &mut Vec<&'static NamedType>) -> String {
    match of.ty {
        DataModelType::Text { capacity } => format!("text up to {capacity} bytes"),
        DataModelType::List { capacity, item } => {
            format!("list of up to {capacity} {}", name(item, used))
        }
        DataModelType::Array { len, item } => format!("{len} x {}", name(item, used)),
        DataModelType::Option(inner) => format!("optional {}", name(inner, used)),
        DataModelType::Struct(_) | DataModelType::Enum(_) => {
            used.push(of);
            of.name.to_string()
        }
        _ => of.name.to_string(),
    }
}
