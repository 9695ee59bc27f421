//! A signed head as a file, `FILE.head`: one JSON object with all that is signed.

use std::path::Path;

use serde_json::{Value, json};
use umi_protocol::head::{EvidenceMark, Head};
use umi_protocol::job::Name;

use crate::journal::{hex, key_id};
use crate::problem::Problem;

/// A head for machines; bytes as hexadecimal digits.
#[must_use]
pub fn json(head: &Head) -> Value {
    json!({
        "seq": head.seq,
        "chain": hex(&head.chain),
        "boot": head.boot,
        "serial": head.serial.as_str(),
        "key_id": key_id(&head.key),
        "nonce": head.nonce.map(|nonce| hex(&nonce)),
        "signature": hex(&head.signature.concat()),
        "public": hex(&head.key),
        "t_us": head.t_us,
        "first_seq": head.first_seq,
        "firmware": head.firmware.as_str(),
        // The board does not know the bytes that it runs.
        "image": (head.image != [0; 32]).then(|| hex(&head.image)),
        "evidence": head.evidence.as_ref().map(|mark| json!({
            "first": mark.first,
            "first_seq": mark.first_seq,
            "first_chain": hex(&mark.first_chain),
            "next": mark.next,
            "chain": hex(&mark.chain),
        })),
    })
}

/// The file's text.
#[must_use]
pub fn text(head: &Head) -> String {
    format!("{}\n", json(head))
}

/// Reads a file. Whether its signature is right is for [`crate::journal::verify`] to say.
///
/// # Errors
/// It cannot be read; `not_a_head`.
pub fn read(path: &Path) -> Result<Head, Problem> {
    let text =
        std::fs::read_to_string(path).map_err(|error| Problem::file("read", path, &error))?;
    parse(&text).ok_or_else(|| {
        let message = format_args!(
            "{} is no head: give a file that `umi log head -o` wrote",
            path.display()
        );
        Problem::trouble("not_a_head", message)
    })
}

/// Reads a file's text; none: it is no head.
#[must_use]
pub fn parse(text: &str) -> Option<Head> {
    let value: Value = serde_json::from_str(text).ok()?;
    let number = |name: &str| value.get(name)?.as_u64();
    let text = |name: &str| value.get(name)?.as_str();
    let name = |field: &str| Name::try_from(text(field)?).ok();
    let signature: [u8; 64] = bytes(text("signature")?)?;
    let (r, s) = signature.split_at(32);
    Some(Head {
        seq: number("seq")?,
        t_us: number("t_us")?,
        first_seq: number("first_seq")?,
        chain: bytes(text("chain")?)?,
        boot: u32::try_from(number("boot")?).ok()?,
        key: bytes(text("public")?)?,
        image: match value.get("image")? {
            Value::Null => [0; 32],
            image => bytes(image.as_str()?)?,
        },
        serial: name("serial")?,
        firmware: name("firmware")?,
        nonce: match value.get("nonce")? {
            Value::Null => None,
            nonce => Some(bytes(nonce.as_str()?)?),
        },
        signature: [r.try_into().ok()?, s.try_into().ok()?],
        evidence: match value.get("evidence") {
            None | Some(Value::Null) => None,
            Some(mark) => Some(evidence(mark)?),
        },
    })
}

fn evidence(value: &Value) -> Option<EvidenceMark> {
    let number = |name: &str| value.get(name)?.as_u64();
    let chain = |name: &str| bytes(value.get(name)?.as_str()?);
    Some(EvidenceMark {
        first: number("first")?,
        first_seq: number("first_seq")?,
        first_chain: chain("first_chain")?,
        next: number("next")?,
        chain: chain("chain")?,
    })
}

/// Bytes from twice as many hexadecimal digits.
pub(crate) fn bytes<const N: usize>(text: &str) -> Option<[u8; N]> {
    let mut out = [0; N];
    let digits = text.as_bytes();
    if digits.len() != 2 * N {
        return None;
    }
    for (place, pair) in out.iter_mut().zip(digits.chunks_exact(2)) {
        let [high, low] = pair else { return None };
        let digit = |byte: &u8| char::from(*byte).to_digit(16);
        *place = u8::try_from(digit(high)? << 4 | digit(low)?).ok()?;
    }
    Some(out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use umi_protocol::job::name;

    /// What was written is read, and what lacks anything is not.
    #[test]
    fn a_head_comes_back_as_it_was() {
        let head = Head {
            seq: u64::MAX,
            t_us: 1,
            first_seq: 2,
            chain: [0xC1; 32],
            boot: 3,
            key: [0xA1; 32],
            image: [0; 32],
            serial: name("0042"),
            firmware: name("0.1.0"),
            nonce: Some([0x5A; 32]),
            evidence: Some(EvidenceMark {
                first: 1,
                first_seq: 5,
                first_chain: [8; 32],
                next: 6,
                chain: [9; 32],
            }),
            signature: [[0x51; 32], [0x52; 32]],
        };
        let value = json(&head);
        assert_eq!(parse(&value.to_string()), Some(head.clone()));
        let alone = Head {
            nonce: None,
            ..head
        };
        assert_eq!(parse(&text(&alone)), Some(alone));
        for field in value.as_object().unwrap().keys() {
            // A head of an older firmware has no evidence: without it the signature is not right.
            if field == "key_id" || field == "evidence" {
                continue;
            }
            let mut less = value.clone();
            less.as_object_mut().unwrap().remove(field);
            assert_eq!(parse(&less.to_string()), None, "{field}");
        }
    }
}
