//! PCD files of the Point Cloud Library, version 0.7: text, binary, and binary compressed by LZF.

use crate::ScanError;
use crate::cloud::{BesidePoint, CloudColumns, ScanCloud};
use crate::rigid::Vec3;

/// Lines of a header at most.
const HEADER_LINES: usize = 200;
/// LZF makes at most 264 bytes of three.
const EXPANSION: usize = 88;

/// Fields beside the coordinates.
const OTHERS: [&str; 6] = [
    "profile",
    "index",
    "t_us",
    "intensity",
    "mount_u_mm",
    "interpolated",
];

/// What a column holds.
#[derive(Clone, Copy)]
struct Field {
    /// Bytes before it in a point.
    offset: usize,
    /// Columns before it in a line of text.
    column: usize,
    size: usize,
    kind: u8,
}

struct Header {
    axes: [Field; 3],
    /// Those of [`OTHERS`] that it has.
    others: [Option<Field>; 6],
    stride: usize,
    columns: usize,
    points: usize,
}

/// Whether the first line that is no comment is that of a PCD file.
pub(super) fn is_pcd(bytes: &[u8]) -> bool {
    let mut lines = bytes.split(|&b| b == b'\n').map(<[u8]>::trim_ascii);
    let first = lines.by_ref().take(HEADER_LINES).find(|l| !l.is_empty());
    first.is_some_and(|line| line.starts_with(b"# .PCD") || line.starts_with(b"VERSION"))
}

pub(super) fn read(bytes: &[u8]) -> Result<ScanCloud, ScanError> {
    let (words, body) = header_lines(bytes)?;
    let data = value(&words, "DATA").and_then(<[&str]>::first).copied();
    let header = Header::new(&words)?;
    match data {
        Some("ascii") => text(&header, body),
        Some("binary") => binary(&header, body),
        Some("binary_compressed") => compressed(&header, body),
        _ => Err(bad("DATA is neither ascii, binary nor binary_compressed")),
    }
}

fn bad(what: &str) -> ScanError {
    ScanError::unreadable("bad_file", what)
}

fn short(points: usize, bytes: usize) -> ScanError {
    ScanError::unreadable(
        "bad_file",
        format_args!(
            "the header states {points} points, more than its {bytes} bytes hold: it is cut short"
        ),
    )
}

/// The words of the header's lines, and what comes behind it.
fn header_lines(bytes: &[u8]) -> Result<(Vec<Vec<&str>>, &[u8]), ScanError> {
    let mut rest = bytes;
    let mut all = Vec::new();
    for _ in 0..HEADER_LINES {
        let Some(end) = rest.iter().position(|&b| b == b'\n') else {
            break;
        };
        let line = std::str::from_utf8(&rest[..end]).map_err(|_| bad("its header is not text"))?;
        rest = &rest[end + 1..];
        let words: Vec<&str> = line.split_ascii_whitespace().collect();
        if words.first().is_none_or(|word| word.starts_with('#')) {
            continue;
        }
        let last = words[0] == "DATA";
        all.push(words);
        if last {
            return Ok((all, rest));
        }
    }
    Err(bad("its header has no line DATA"))
}

/// The values of a line of the header.
fn value<'a>(words: &'a [Vec<&'a str>], name: &str) -> Option<&'a [&'a str]> {
    words
        .iter()
        .find(|line| line[0] == name)
        .map(|line| &line[1..])
}

impl Header {
    fn new(words: &[Vec<&str>]) -> Result<Self, ScanError> {
        let numbers = |name: &str| -> Option<Vec<usize>> {
            value(words, name)?
                .iter()
                .map(|word| word.parse().ok())
                .collect()
        };
        let names = value(words, "FIELDS").ok_or_else(|| bad("its header has no line FIELDS"))?;
        let sizes = numbers("SIZE").ok_or_else(|| bad("its header has no line SIZE"))?;
        let kinds = value(words, "TYPE").ok_or_else(|| bad("its header has no line TYPE"))?;
        let counts = numbers("COUNT").unwrap_or_else(|| vec![1; names.len()]);
        if [sizes.len(), kinds.len(), counts.len()] != [names.len(); 3] {
            return Err(bad("FIELDS, SIZE, TYPE and COUNT are not of one length"));
        }
        let (mut axes, mut others) = ([None; 3], [None; 6]);
        let (mut stride, mut columns) = (0_usize, 0_usize);
        for (i, name) in names.iter().enumerate() {
            let field = Field {
                offset: stride,
                column: columns,
                size: sizes[i],
                kind: kinds[i].as_bytes().first().copied().unwrap_or(0),
            };
            if let Some(axis) = ["x", "y", "z"].iter().position(|axis| axis == name) {
                if !field.is_known() || counts[i] != 1 {
                    return Err(bad("its coordinates are of a type that is not known"));
                }
                axes[axis] = Some(field);
            }
            let other = OTHERS.iter().position(|other| other == name);
            if let Some(other) = other.filter(|_| field.is_known() && counts[i] == 1) {
                others[other] = Some(field);
            }
            let bytes = sizes[i].checked_mul(counts[i]);
            stride = bytes
                .and_then(|bytes| stride.checked_add(bytes))
                .ok_or_else(|| bad("its points are larger than any file"))?;
            columns = columns
                .checked_add(counts[i])
                .ok_or_else(|| bad("its points are larger than any file"))?;
        }
        let [Some(x), Some(y), Some(z)] = axes else {
            return Err(bad("its FIELDS have no x, y and z"));
        };
        let one = |name: &str| numbers(name).and_then(|all| all.first().copied());
        let points = one("POINTS")
            .or_else(|| one("WIDTH")?.checked_mul(one("HEIGHT")?))
            .ok_or_else(|| bad("its header does not state the number of points"))?;
        Ok(Self {
            axes: [x, y, z],
            others,
            stride,
            columns,
            points,
        })
    }

    /// A cloud without points, for all of them.
    fn cloud(&self) -> ScanCloud {
        let has = self.others.map(|field| field.is_some());
        let [profile, index, time, intensity, mount_u, interpolated] = has;
        let mut cloud = ScanCloud {
            columns: CloudColumns {
                profile,
                index,
                time,
                intensity,
                mount_u,
                interpolated,
            },
            ..ScanCloud::default()
        };
        cloud.points.reserve_exact(self.points);
        cloud
    }

    /// Takes a point by what `number` says of each field.
    fn take(&self, cloud: &mut ScanCloud, number: impl Fn(Field) -> Option<f64>) -> Option<()> {
        let [x, y, z] = self.axes.map(&number);
        let mut beside = [0.0; 6];
        for (value, field) in beside.iter_mut().zip(self.others) {
            if let Some(field) = field {
                *value = number(field)?;
            }
        }
        let [profile, index, t_us, intensity, mount_u_mm, interpolated] = beside;
        cloud.push_with(
            Vec3::new(x?, y?, z?),
            BesidePoint {
                // Casts end at the bounds: a number that is none becomes 0.
                profile: profile as u64,
                index: index as u32,
                t_us,
                intensity,
                mount_u_mm,
                interpolated: interpolated != 0.0,
            },
        );
        Some(())
    }
}

impl Field {
    fn is_known(self) -> bool {
        match self.kind {
            b'F' => [4, 8].contains(&self.size),
            b'I' | b'U' => [1, 2, 4, 8].contains(&self.size),
            _ => false,
        }
    }

    /// The number in the first bytes of `bytes`, which are as many as its size.
    fn number(self, bytes: &[u8]) -> f64 {
        let raw = (0..self.size).fold(0_u64, |raw, i| raw | u64::from(bytes[i]) << (8 * i));
        let unused = 64 - 8 * self.size as u32;
        match (self.kind, self.size) {
            (b'F', 4) => f64::from(f32::from_bits(raw as u32)),
            (b'F', _) => f64::from_bits(raw),
            (b'I', _) => ((raw << unused) as i64 >> unused) as f64,
            _ => raw as f64,
        }
    }
}

fn text(header: &Header, body: &[u8]) -> Result<ScanCloud, ScanError> {
    // The shortest number with what parts it from the next takes two bytes.
    let least = header.columns.saturating_mul(2).max(1);
    if header.points > (body.len() + 1) / least {
        return Err(short(header.points, body.len()));
    }
    let mut cloud = header.cloud();
    let mut lines = body
        .split(|&b| b == b'\n')
        .map(<[u8]>::trim_ascii)
        .filter(|line| !line.is_empty());
    for i in 0..header.points {
        let wrong =
            |what: &str| ScanError::unreadable("bad_file", format_args!("point {}: {what}", i + 1));
        let line = lines
            .next()
            .ok_or_else(|| wrong("the file ends before it"))?;
        let line = std::str::from_utf8(line).map_err(|_| wrong("it is not text"))?;
        let number = |field: Field| {
            let word = line.split_ascii_whitespace().nth(field.column)?;
            word.parse::<f64>().ok()
        };
        header
            .take(&mut cloud, number)
            .ok_or_else(|| wrong("its coordinates are no numbers"))?;
    }
    Ok(cloud)
}

fn binary(header: &Header, body: &[u8]) -> Result<ScanCloud, ScanError> {
    let needed = header.points.checked_mul(header.stride);
    if needed.is_none_or(|needed| needed > body.len()) {
        return Err(short(header.points, body.len()));
    }
    let mut cloud = header.cloud();
    for record in body.chunks_exact(header.stride).take(header.points) {
        header.take(&mut cloud, |field| {
            Some(field.number(&record[field.offset..]))
        });
    }
    Ok(cloud)
}

/// All x, then all y, and so on.
fn compressed(header: &Header, body: &[u8]) -> Result<ScanCloud, ScanError> {
    let size = |at: usize| -> Option<usize> {
        let four = body.get(at..at + 4)?.try_into().ok()?;
        Some(u32::from_le_bytes(four) as usize)
    };
    let (Some(packed), Some(whole)) = (size(0), size(4)) else {
        return Err(bad("it ends before its compressed points"));
    };
    let packed = body
        .get(8..8 + packed)
        .ok_or_else(|| bad("its compressed points are cut short"))?;
    let needed = header.points.checked_mul(header.stride);
    if needed != Some(whole) || whole / EXPANSION > packed.len() {
        return Err(short(header.points, packed.len()));
    }
    let bytes = unpacked(packed, whole).ok_or_else(|| bad("its compressed points are damaged"))?;
    let mut cloud = header.cloud();
    for i in 0..header.points {
        header.take(&mut cloud, |field| {
            let column = field.offset * header.points;
            Some(field.number(&bytes[column + i * field.size..]))
        });
    }
    Ok(cloud)
}

/// What LZF had packed (M. Lehmann, LibLZF): runs of bytes as they are, and references back.
fn unpacked(packed: &[u8], whole: usize) -> Option<Vec<u8>> {
    let mut out: Vec<u8> = Vec::with_capacity(whole);
    let mut at = 0;
    while at < packed.len() {
        let control = usize::from(packed[at]);
        at += 1;
        if control < 32 {
            out.extend_from_slice(packed.get(at..=at + control)?);
            at += control + 1;
        } else {
            let mut length = control >> 5;
            if length == 7 {
                length += usize::from(*packed.get(at)?);
                at += 1;
            }
            let back = ((control & 31) << 8) + usize::from(*packed.get(at)?) + 1;
            at += 1;
            let from = out.len().checked_sub(back)?;
            for k in from..from + length + 2 {
                out.push(out[k]);
            }
        }
        if out.len() > whole {
            return None;
        }
    }
    (out.len() == whole).then_some(out)
}
