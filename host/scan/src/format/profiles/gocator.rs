//! A Gocator's data channel, byte for byte, little endian.
//!
//! A message begins with its size (u32, all of it) and control word (u16: bits 0-14 its type,
//! bit 15 the last of its group). Type 1 are stamps, type 5 profiles as pairs (x, z), type 6
//! profiles of evenly spaced z, type 7 a byte of intensity for each sample of those, which is read
//! only where that is asked for. Other types are skipped. Stamps, profiles and intensities of a
//! group belong together in their order. Sizes of stamps and attributes are those that the message says,
//! because they grow with the sensor's firmware.

use std::collections::VecDeque;
use std::io::Read;

use super::Depth;
use crate::ScanError;
use crate::profile::{Profile, ProfilePoint, Stamp};

/// The sensor's clock counts 1.024 times as fast as microseconds pass.
const TICKS_PER_US: f64 = 1.024;
/// A sample without a range; every other value is one.
const NO_RANGE: i16 = i16::MIN;
/// The largest message that makes sense, in bytes.
const LARGEST: u32 = 1 << 26;
/// The largest group that makes sense, in bytes of its profiles.
const LARGEST_GROUP: usize = 1 << 27;
/// The type of a message of intensities.
const INTENSITIES: u16 = 7;
/// Bytes of size and control word.
const HEAD: usize = 6;

/// The stamp of a frame, as a message has it.
#[derive(Debug, Clone, Copy)]
struct Tick {
    frame: u64,
    t_us: f64,
    encoder: i64,
}

/// Hands out every profile of a capture; the frames that it left out.
///
/// Who belongs to whom is known when a group has ended, or when a stamp follows as many profiles as there were stamps.
/// A group with more stamps than profiles lost some of these on the way: nothing says which, so all of it is left out.
///
/// # Errors
/// `truncated` where the capture ends within a message or between a stamp and its profile,
/// `corrupt` where sizes contradict or profiles have no stamp, or what `take` refuses.
pub fn visit<R: Read>(
    mut input: R,
    name: &str,
    depth: Depth,
    mut take: impl FnMut(&Profile<'_>) -> Result<(), ScanError>,
) -> Result<Vec<u64>, ScanError> {
    let mut channel = Channel {
        name,
        at: 0,
        profiles: 0,
        ticks: VecDeque::new(),
        left_out: Vec::new(),
    };
    let mut group = Group::default();
    let mut samples = Vec::new();
    let mut message = group.spare.pop().unwrap_or_default();
    while channel.read(&mut input, &mut message)? {
        let control = u16_at(&message, 4);
        let bytes = message.len() as u64;
        match control & 0x7FFF {
            1 => {
                if group.rows > 0 && group.rows == channel.ticks.len() {
                    channel.end(&mut group, depth, &mut samples, &mut take)?;
                }
                channel.stamps(&message)?;
            }
            5 | 6 => {
                group.rows = group.rows.saturating_add(channel.layout(&message)?.count);
                group.bytes += message.len();
                if group.bytes > LARGEST_GROUP {
                    return Err(channel.error("corrupt", "a group of messages that never ends"));
                }
                group.messages.push(std::mem::replace(
                    &mut message,
                    group.spare.pop().unwrap_or_default(),
                ));
            }
            INTENSITIES if depth == Depth::Intensities => {
                group.bytes += message.len();
                if group.bytes > LARGEST_GROUP {
                    return Err(channel.error("corrupt", "a group of messages that never ends"));
                }
                group.bright.push(channel.bright(&message)?);
            }
            _ => {}
        }
        group.is_open = control & 0x8000 == 0;
        if !group.is_open {
            channel.end(&mut group, depth, &mut samples, &mut take)?;
        }
        channel.at += bytes;
    }
    if group.is_open && group.rows != channel.ticks.len() {
        return Err(channel.error(
            "truncated",
            "the capture ends between a stamp and its profile",
        ));
    }
    channel.end(&mut group, depth, &mut samples, &mut take)?;
    Ok(channel.left_out)
}

/// Profile messages whose group has not ended.
#[derive(Default)]
struct Group {
    is_open: bool,
    messages: Vec<Vec<u8>>,
    /// Profiles in them.
    rows: usize,
    /// Intensities of the group's profiles, in their order.
    bright: Vec<Bright>,
    bytes: usize,
    /// Buffers to be used again.
    spare: Vec<Vec<u8>>,
}

/// A message of intensities.
struct Bright {
    width: usize,
    /// A byte each, profile by profile.
    values: Vec<u8>,
    count: usize,
}

struct Channel<'a> {
    name: &'a str,
    /// Where the message begins, in bytes.
    at: u64,
    /// Profiles so far.
    profiles: u64,
    /// Stamps whose profiles have not come yet.
    ticks: VecDeque<Tick>,
    /// Frames whose profile was lost within its group, or cannot be told from one that was.
    left_out: Vec<u64>,
}

impl Channel<'_> {
    /// Reads the next message; false at the end of the capture.
    fn read<R: Read>(&self, input: &mut R, message: &mut Vec<u8>) -> Result<bool, ScanError> {
        message.clear();
        let cut = |error: std::io::Error| {
            if error.kind() == std::io::ErrorKind::UnexpectedEof {
                self.error(
                    "truncated",
                    "the capture ends within this message: it was cut",
                )
            } else {
                ScanError::unreadable("file", format_args!("cannot read {}: {error}", self.name))
            }
        };
        let got = Read::take(&mut *input, HEAD as u64)
            .read_to_end(message)
            .map_err(cut)?;
        if got == 0 {
            return Ok(false);
        }
        // A size that makes no sense is told from a cut even where both are the case.
        if got >= 4 {
            let size = u32_at(message, 0);
            if !(HEAD as u32..=LARGEST).contains(&size) {
                return Err(self.error(
                    "corrupt",
                    &format!("a message of {size} bytes makes no sense"),
                ));
            }
        }
        if got < HEAD {
            return Err(cut(std::io::ErrorKind::UnexpectedEof.into()));
        }
        message.resize(u32_at(message, 0) as usize, 0);
        input.read_exact(&mut message[HEAD..]).map_err(cut)?;
        Ok(true)
    }

    /// Hands out the profiles of a group, if they belong to its stamps.
    fn end(
        &mut self,
        group: &mut Group,
        depth: Depth,
        samples: &mut Vec<ProfilePoint>,
        take: &mut impl FnMut(&Profile<'_>) -> Result<(), ScanError>,
    ) -> Result<(), ScanError> {
        if group.rows < self.ticks.len() {
            self.left_out
                .extend(self.ticks.drain(..).map(|tick| tick.frame));
        } else {
            // Where there are not as many as profiles nobody knows whose they are.
            let count = (group.bright.iter()).fold(0_usize, |n, b| n.saturating_add(b.count));
            let all_there = count == group.rows;
            let mut bright = group.bright.iter().flat_map(Bright::rows);
            for message in &group.messages {
                let mut of_profile = || bright.next().filter(|_| all_there);
                self.profiles(message, depth, samples, &mut of_profile, take)?;
            }
        }
        group.bright.clear();
        group.spare.append(&mut group.messages);
        (group.rows, group.bytes) = (0, 0);
        Ok(())
    }

    fn stamps(&mut self, message: &[u8]) -> Result<(), ScanError> {
        const BEGIN: usize = 14;
        if message.len() < BEGIN {
            return Err(self.error("corrupt", "a stamp message without its count and size"));
        }
        let count = u32_at(message, 6) as usize;
        let size = usize::from(u16_at(message, 10));
        if size < 24 && count > 0 {
            return Err(self.error(
                "corrupt",
                &format!("stamps of {size} bytes hold no frame, time and encoder"),
            ));
        }
        if count
            .checked_mul(size)
            .is_none_or(|n| n > message.len() - BEGIN)
        {
            return Err(self.error(
                "corrupt",
                &format!("{count} stamps of {size} bytes do not fit into their message"),
            ));
        }
        for stamp in message[BEGIN..].chunks_exact(size.max(1)).take(count) {
            self.ticks.push_back(Tick {
                frame: u64_at(stamp, 0),
                t_us: u64_at(stamp, 8) as f64 / TICKS_PER_US,
                encoder: u64_at(stamp, 16).cast_signed(),
            });
        }
        Ok(())
    }

    /// The intensities of a message, of which only count and width must fit.
    fn bright(&self, message: &[u8]) -> Result<Bright, ScanError> {
        const ATTRIBUTES: usize = 8;
        /// Count and width.
        const LEAST: usize = 8;
        let size = usize::from(u16_at(message, 6));
        let begin = ATTRIBUTES + size;
        if size < LEAST || begin > message.len() {
            return Err(self.error(
                "corrupt",
                &format!("attributes of {size} bytes make no sense in this message of intensities"),
            ));
        }
        let (count, width) = (u32_at(message, 8) as usize, u32_at(message, 12) as usize);
        let end = (count.checked_mul(width)).and_then(|bytes| bytes.checked_add(begin));
        let values = end.and_then(|end| message.get(begin..end));
        let values = values.map(<[u8]>::to_vec).ok_or_else(|| {
            self.error(
                "corrupt",
                &format!("{count} profiles of {width} intensities do not fit into their message"),
            )
        })?;
        Ok(Bright {
            width,
            values,
            count,
        })
    }

    fn profiles<'b>(
        &mut self,
        message: &[u8],
        depth: Depth,
        samples: &mut Vec<ProfilePoint>,
        bright: &mut dyn FnMut() -> Option<&'b [u8]>,
        take: &mut impl FnMut(&Profile<'_>) -> Result<(), ScanError>,
    ) -> Result<(), ScanError> {
        let layout = self.layout(message)?;
        let mut intensities = Vec::new();
        for row in 0..layout.count {
            let Some(tick) = self.ticks.pop_front() else {
                return Err(self.error("corrupt", "a profile without a stamp in its group"));
            };
            samples.clear();
            let mut invalid = 0;
            if depth != Depth::Stamps {
                let begin = layout.begin + row * layout.width * layout.stride();
                let data = &message[begin..begin + layout.width * layout.stride()];
                invalid = layout.decode(data, samples);
            }
            let stamp = Stamp {
                profile: self.profiles,
                frame: tick.frame,
                t_us: tick.t_us,
                encoder: Some(tick.encoder),
            };
            self.profiles += 1;
            let bright = bright();
            if let Some(bright) = bright {
                if bright.len() != layout.width {
                    return Err(self.error(
                        "corrupt",
                        &format!(
                            "a profile of {} samples with {} intensities",
                            layout.width,
                            bright.len()
                        ),
                    ));
                }
                let of = |sample: &ProfilePoint| bright.get(sample.index as usize);
                intensities.clear();
                intensities.extend(samples.iter().filter_map(of).map(|&byte| f64::from(byte)));
            }
            take(&Profile {
                stamp,
                samples,
                intensities: bright.map(|_| &*intensities),
                invalid,
            })?;
        }
        Ok(())
    }

    fn layout(&self, message: &[u8]) -> Result<Layout, ScanError> {
        const ATTRIBUTES: usize = 8;
        /// Count, width, scales and offsets.
        const LEAST: usize = 24;
        if message.len() < ATTRIBUTES {
            return Err(self.error("corrupt", "a profile message without attributes"));
        }
        let size = usize::from(u16_at(message, 6));
        if size < LEAST || ATTRIBUTES + size > message.len() {
            return Err(self.error(
                "corrupt",
                &format!("attributes of {size} bytes make no sense in this message"),
            ));
        }
        let layout = Layout {
            pairs: u16_at(message, 4) & 0x7FFF == 5,
            count: u32_at(message, 8) as usize,
            width: u32_at(message, 12) as usize,
            x_scale_mm: f64::from(u32_at(message, 16)) * 1e-6,
            z_scale_mm: f64::from(u32_at(message, 20)) * 1e-6,
            x_offset_mm: f64::from(u32_at(message, 24).cast_signed()) * 1e-3,
            z_offset_mm: f64::from(u32_at(message, 28).cast_signed()) * 1e-3,
            begin: ATTRIBUTES + size,
        };
        let bytes = layout
            .count
            .checked_mul(layout.width)
            .and_then(|n| n.checked_mul(layout.stride()));
        // Profiles without samples need no bytes: their number is held to the stamps'.
        if bytes.is_none_or(|n| n > message.len() - layout.begin) {
            return Err(self.error(
                "corrupt",
                &format!(
                    "{} profiles of {} samples do not fit into their message",
                    layout.count, layout.width
                ),
            ));
        }
        // Samples without a pitch would all lie in one place.
        let flat = layout.x_scale_mm == 0.0 || layout.z_scale_mm == 0.0;
        if flat && layout.count > 0 && layout.width > 0 {
            return Err(self.error("corrupt", "samples with a scale of 0"));
        }
        Ok(layout)
    }

    fn error(&self, code: &'static str, what: &str) -> ScanError {
        ScanError::unreadable(
            code,
            format_args!("{}, byte {}: {what}", self.name, self.at),
        )
        .with("byte", self.at)
    }
}

impl Bright {
    /// Profile by profile.
    fn rows(&self) -> impl Iterator<Item = &[u8]> {
        (0..self.count).map(|row| {
            let begin = row * self.width;
            self.values.get(begin..begin + self.width).unwrap_or(&[])
        })
    }
}

/// How the samples of a message are laid out.
struct Layout {
    /// Pairs (x, z); else z alone.
    pairs: bool,
    count: usize,
    width: usize,
    x_scale_mm: f64,
    z_scale_mm: f64,
    x_offset_mm: f64,
    z_offset_mm: f64,
    begin: usize,
}

impl Layout {
    /// Bytes of a sample.
    const fn stride(&self) -> usize {
        if self.pairs { 4 } else { 2 }
    }

    /// Decodes one profile; the number of samples without a range.
    fn decode(&self, data: &[u8], samples: &mut Vec<ProfilePoint>) -> u64 {
        let sample = |index: usize, x: f64, z: i16| ProfilePoint {
            index: index as u32,
            x_mm: self.x_offset_mm + self.x_scale_mm * x,
            z_mm: self.z_offset_mm + self.z_scale_mm * f64::from(z),
        };
        if self.pairs {
            let (pairs, _) = data.as_chunks::<4>();
            samples.extend(
                pairs
                    .iter()
                    .enumerate()
                    .filter_map(|(index, &[a, b, c, d])| {
                        let z = i16::from_le_bytes([c, d]);
                        (z != NO_RANGE)
                            .then(|| sample(index, f64::from(i16::from_le_bytes([a, b])), z))
                    }),
            );
        } else {
            let (zs, _) = data.as_chunks::<2>();
            samples.extend(zs.iter().enumerate().filter_map(|(index, &bytes)| {
                let z = i16::from_le_bytes(bytes);
                (z != NO_RANGE).then(|| sample(index, index as f64, z))
            }));
        }
        (self.width - samples.len()) as u64
    }
}

/// Places are checked by the caller; a byte beyond the end is 0.
fn bytes_at<const N: usize>(bytes: &[u8], at: usize) -> [u8; N] {
    std::array::from_fn(|i| bytes.get(at + i).copied().unwrap_or(0))
}

fn u16_at(bytes: &[u8], at: usize) -> u16 {
    u16::from_le_bytes(bytes_at(bytes, at))
}

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(bytes_at(bytes, at))
}

fn u64_at(bytes: &[u8], at: usize) -> u64 {
    u64::from_le_bytes(bytes_at(bytes, at))
}

#[cfg(test)]
mod tests {
    use super::*;

    const LAST: u16 = 0x8000;

    fn message(control: u16, body: &[u8]) -> Vec<u8> {
        let size = (HEAD + body.len()) as u32;
        [&size.to_le_bytes()[..], &control.to_le_bytes(), body].concat()
    }

    /// A stamp message; each stamp is `size` bytes, of which a firmware may have more.
    fn stamps(control: u16, size: u16, frames: &[(u64, u64, i64)]) -> Vec<u8> {
        let mut body = (frames.len() as u32).to_le_bytes().to_vec();
        body.extend(size.to_le_bytes());
        body.extend([1, 0]);
        for (frame, ticks, encoder) in frames {
            let begin = body.len();
            body.extend(frame.to_le_bytes());
            body.extend(ticks.to_le_bytes());
            body.extend(encoder.to_le_bytes());
            body.resize(begin + usize::from(size), 0xAB);
        }
        message(1 | control, &body)
    }

    /// A profile message with attributes of `size` bytes.
    fn profiles(kind: u16, size: u16, width: u32, values: &[i16]) -> Vec<u8> {
        let per = if kind == 5 { 2 } else { 1 };
        let count = values.len() as u32 / (per * width).max(1);
        let mut body = size.to_le_bytes().to_vec();
        for value in [count, width, 50_000, 10_000] {
            body.extend(value.to_le_bytes());
        }
        for offset in [-2000_i32, 90_000] {
            body.extend(offset.to_le_bytes());
        }
        body.resize(2 + usize::from(size), 0xCD);
        body.extend(values.iter().flat_map(|value| value.to_le_bytes()));
        message(kind | LAST, &body)
    }

    type Taken = Vec<(Stamp, Vec<ProfilePoint>, u64)>;

    fn read(bytes: &[u8]) -> Result<Taken, ScanError> {
        let mut all = Vec::new();
        visit(bytes, "capture", Depth::Samples, |profile| {
            all.push((profile.stamp, profile.samples.to_vec(), profile.invalid));
            Ok(())
        })?;
        Ok(all)
    }

    #[test]
    fn batches_of_both_kinds_go_to_their_stamps_in_order() {
        let capture = [
            stamps(0, 40, &[(7, 1024, -5), (8, 2048, 6)]),
            message(99, &[1, 2, 3]),
            profiles(5, 60, 2, &[1, 10, 2, i16::MIN, -3, -10, i16::MIN, 0]),
            stamps(0, 72, &[(9, 4096, 7)]),
            profiles(6, 24, 3, &[5, i16::MIN, -5]),
        ]
        .concat();
        let all = read(&capture).unwrap();
        assert_eq!(all.len(), 3);
        let stamp = |i: usize| {
            (
                all[i].0.profile,
                all[i].0.frame,
                all[i].0.t_us,
                all[i].0.encoder,
            )
        };
        assert_eq!(stamp(0), (0, 7, 1000.0, Some(-5)));
        assert_eq!(stamp(1), (1, 8, 2000.0, Some(6)));
        assert_eq!(stamp(2), (2, 9, 4000.0, Some(7)));
        // Only z says whether there is a range: x may be any number.
        assert_eq!((all[0].1.len(), all[0].2), (1, 1));
        assert_eq!((all[1].1.len(), all[1].2), (2, 0));
        let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-12, "{a} {b}");
        near(all[0].1[0].x_mm, -2.0 + 0.05);
        near(all[0].1[0].z_mm, 90.0 + 0.1);
        near(all[1].1[1].x_mm, -2.0 - 0.05 * 32768.0);
        // Evenly spaced: x by the place in the array.
        assert_eq!(all[2].1[1].index, 2);
        near(all[2].1[1].x_mm, -2.0 + 0.1);
    }

    #[test]
    fn a_cut_at_any_byte_is_told_or_ends_between_groups() {
        let group = [
            stamps(0, 40, &[(7, 1024, -5)]),
            profiles(5, 24, 2, &[1, 10, 2, 11]),
        ]
        .concat();
        let capture = [group.clone(), group.clone()].concat();
        for cut in 0..capture.len() {
            match read(&capture[..cut]) {
                Ok(all) => assert_eq!(all.len() * group.len(), cut),
                Err(error) => assert_eq!(error.code, "truncated", "{cut}: {error}"),
            }
        }
    }

    #[test]
    fn sizes_that_contradict_are_corrupt() {
        let stamp = || stamps(0, 40, &[(7, 1024, -5)]);
        let mut narrow = stamp();
        narrow[10] = 8;
        let mut many = stamp();
        many[6] = 200;
        let mut wide = profiles(5, 24, 2, &[1, 10, 2, 11]);
        wide[12] = 200;
        let mut attributes = profiles(5, 24, 2, &[1, 10, 2, 11]);
        attributes[6..8].copy_from_slice(&9999_u16.to_le_bytes());
        let mut flat = profiles(5, 24, 2, &[1, 10, 2, 11]);
        flat[20..24].fill(0);
        for capture in [
            narrow,
            many,
            [stamp(), flat].concat(),
            [stamp(), wide].concat(),
            [stamp(), attributes].concat(),
            profiles(5, 24, 2, &[1, 10, 2, 11]),
        ] {
            assert_eq!(read(&capture).unwrap_err().code, "corrupt");
        }
    }

    /// Intensities of `count` profiles.
    fn bright(control: u16, width: u32, values: &[u8]) -> Vec<u8> {
        let mut body = 24_u16.to_le_bytes().to_vec();
        for value in [values.len() as u32 / width.max(1), width, 50_000] {
            body.extend(value.to_le_bytes());
        }
        body.resize(2 + 24, 0xCD);
        body.extend(values);
        message(INTENSITIES | control, &body)
    }

    fn read_bright(bytes: &[u8]) -> Result<Vec<Option<Vec<f64>>>, ScanError> {
        let mut all = Vec::new();
        visit(bytes, "capture", Depth::Intensities, |profile| {
            all.push(profile.intensities.map(<[f64]>::to_vec));
            Ok(())
        })?;
        Ok(all)
    }

    /// Each sample with a range gets the byte at its own place in the array, in batches as well; a group that lost its
    /// intensities has none rather than those of another.
    #[test]
    fn intensities_go_to_the_samples_of_their_profile() {
        let mut open = profiles(
            5,
            60,
            3,
            &[1, 10, 2, i16::MIN, 3, 30, 4, i16::MIN, 5, 50, 6, 60],
        );
        open[5] &= 0x7F;
        let capture = [
            stamps(0, 40, &[(7, 1024, 0), (8, 2048, 0)]),
            open,
            bright(LAST, 3, &[11, 12, 13, 14, 15, 255]),
            stamps(0, 40, &[(9, 4096, 0)]),
            profiles(6, 24, 2, &[5, -5]),
        ]
        .concat();
        let due = [Some(vec![11.0, 13.0]), Some(vec![15.0, 255.0]), None];
        assert_eq!(read_bright(&capture).unwrap(), due);
        // Who does not ask reads the same profiles as from a capture without.
        let taken = read(&capture).unwrap();
        assert_eq!(taken.len(), 3);
        // One row for two profiles: nobody knows whose.
        let mut open = profiles(6, 24, 1, &[5, 6]);
        open[5] &= 0x7F;
        let two = stamps(0, 40, &[(7, 1024, 0), (8, 2048, 0)]);
        let short = [two.clone(), open.clone(), bright(LAST, 1, &[9])].concat();
        assert_eq!(read_bright(&short).unwrap(), [None, None]);
        // Sizes that contradict are told to who asks, and to nobody else.
        let wide = [two.clone(), open.clone(), bright(LAST, 2, &[1, 2, 3, 4])].concat();
        let mut beyond = bright(LAST, 1, &[1, 2]);
        beyond[8] = 200;
        for capture in [wide, [two, open, beyond].concat()] {
            assert_eq!(read_bright(&capture).unwrap_err().code, "corrupt");
            assert_eq!(read(&capture).unwrap().len(), 2);
        }
        let huge = |count: u32, width: u32| {
            let mut message = bright(LAST, 1, &[]);
            message[8..12].copy_from_slice(&count.to_le_bytes());
            message[12..16].copy_from_slice(&width.to_le_bytes());
            message
        };
        // No room for these, and endless rows without a byte do not run forever.
        assert_eq!(
            read_bright(&huge(u32::MAX, u32::MAX)).unwrap_err().code,
            "corrupt"
        );
        assert_eq!(read_bright(&huge(u32::MAX, 0)).unwrap(), []);
    }

    /// A profile that was lost on the way leaves its stamp behind: the next profile must not get it.
    #[test]
    fn a_group_that_lost_a_profile_is_left_out_and_named() {
        let group = |frame: u64| {
            let stamp = stamps(0, 40, &[(frame, 1024 * frame, 0)]);
            [stamp, profiles(5, 24, 1, &[frame as i16, 10])]
        };
        let batch = stamps(0, 40, &[(20, 20_480, 0), (21, 21_504, 0)]);
        let [one, two, three, four] = [7, 8, 9, 10].map(group);
        let capture = [
            &one[0], &one[1], &two[0], &three[0], &three[1], &batch, &one[1], &four[0], &four[1],
        ];
        let capture: Vec<u8> = capture.into_iter().flatten().copied().collect();
        let mut came = Vec::new();
        let left_out = visit(capture.as_slice(), "c", Depth::Samples, |profile| {
            came.push((profile.stamp.frame, profile.samples[0].x_mm));
            Ok(())
        });
        assert_eq!(left_out.unwrap(), [8, 9, 20, 21]);
        let frames: Vec<u64> = came.iter().map(|(frame, _)| *frame).collect();
        assert_eq!(frames, [7, 10]);
        for (frame, x_mm) in came {
            assert!((x_mm - (-2.0 + 0.05 * frame as f64)).abs() < 1e-9);
        }
        // Behind the last group as well.
        let [stamp, _] = group(11);
        let mut last = stamp.clone();
        last[5] = 0x80;
        let alone = visit(last.as_slice(), "c", Depth::Stamps, |_| Ok(()));
        assert_eq!(alone.unwrap(), [11]);
        let cut = visit(stamp.as_slice(), "c", Depth::Stamps, |_| Ok(()));
        assert_eq!(cut.unwrap_err().code, "truncated");
    }

    /// Any split of the stream gives the same profiles.
    #[test]
    fn a_stream_in_pieces_is_the_same() {
        struct Pieces<'a>(&'a [u8], usize);
        impl Read for Pieces<'_> {
            fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
                let n = self.1.min(out.len()).min(self.0.len());
                out[..n].copy_from_slice(&self.0[..n]);
                self.0 = &self.0[n..];
                Ok(n)
            }
        }
        let capture = [
            stamps(0, 40, &[(7, 1024, -5)]),
            profiles(6, 24, 3, &[5, i16::MIN, -5]),
        ]
        .concat();
        let whole = read(&capture).unwrap();
        for size in 1..capture.len() {
            let mut all = Vec::new();
            visit(Pieces(&capture, size), "c", Depth::Samples, |profile| {
                all.push((profile.stamp, profile.samples.to_vec(), profile.invalid));
                Ok(())
            })
            .unwrap();
            assert_eq!(all, whole, "{size}");
        }
    }
}
