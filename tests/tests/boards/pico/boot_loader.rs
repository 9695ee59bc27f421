//! Signed images on the Pico: the boot loader and the images of both places, whole, on the emulated chip.
//! What decides is in `umi_core::trust::access::update::slots`, whose tests cut the power everywhere.

use std::fs;
use std::time::{Duration, Instant};

use serde_json::json;
use umi_client::board::link::{Client, Patience};
use umi_client::files::image_file::{self, Image};
use umi_client::files::key_file::SigningKey;
use umi_client::journal::{head, hex};
use umi_protocol::message::Record;
use umi_protocol::program::MAX_PIECE;
use umi_protocol::update::{
    IMAGE_HEADER, ImageInfo, ImagePlace, ImageVersion, UpdateRefusal, UpdateState,
};
use umi_tests::cases::patience;
use umi_tests::rig::pico::{CYCLES_PER_US, EmulatedOutput, Emulator, PicoRig, Start};
use umi_tests::rig::{Rig, image, skip_without};

use crate::owner::{host, pulled, secret};

/// Where things stand: firmware/boards/pico/src/storage/chip_flash.rs.
const MAKER_AT: u32 = 0x1001_0000 - 32;
const PLACE_A: u32 = 0x1001_4000;
const PLACE_B: u32 = 0x1010_8000;
/// From the header's end to the code.
const BEFORE_CODE: usize = 64;

const STATUS_LIGHT: u8 = 25;
/// From a reset to the image, promised: 1.5 s, of which hashing is nearly all.
const START_CYCLES: u64 = 1_500_000 * CYCLES_PER_US;
const PATIENCE: Duration = Duration::from_secs(900);

fn maker() -> SigningKey {
    secret(0x3A)
}

/// The payload of the image that is built for a place.
fn payload(place: &str) -> Result<Vec<u8>, String> {
    let file = image("", &format!("pico-{place}.bin"))?;
    let code = fs::read(file).map_err(|error| error.to_string())?;
    Ok([&[0xFF; BEFORE_CODE][..], &code].concat())
}

fn signed(
    by: &SigningKey,
    place: &str,
    version: ImageVersion,
    counter: u32,
    payload: &[u8],
) -> Vec<u8> {
    let board = format!("pico-{place}");
    image_file::sign(payload, &board, version, counter, by)
        .unwrap()
        .1
}

/// A board with a boot loader that has the maker's key, and with these bytes at its places.
fn board(a: &[u8], b: &[u8]) -> Result<PicoRig, String> {
    let mut emulator = Emulator::start_image(&image("", "pico-boot.elf")?, Start::Paused)?;
    let key = maker().verifying_key().to_bytes();
    for (address, bytes) in [(MAKER_AT, &key[..]), (PLACE_A, a), (PLACE_B, b)] {
        write(&mut emulator, address, bytes);
    }
    let mut rig = PicoRig::begun(emulator)?;
    rig.erase_quickly();
    Ok(rig)
}

/// Changes the flash, as a debug probe does.
fn write(emulator: &mut Emulator, address: u32, bytes: &[u8]) {
    let bytes = hex(bytes);
    emulator.ask(&json!({ "do": "flash_write", "address": address, "bytes": bytes }));
}

/// A board that runs version 1.0.0 at place A, and the images that it is built of.
fn running() -> Option<(PicoRig, Vec<u8>)> {
    let made = payload("a").and_then(|a| {
        let first = signed(&maker(), "a", [1, 0, 0], 1, &a);
        Ok((board(&first, &[])?, payload("b")?))
    });
    skip_without(made)
}

/// Sends an image to its end: why it is not taken. None: the board has gone.
fn send(client: &mut Client, bytes: &[u8]) -> Option<Result<(), UpdateRefusal>> {
    let image: Image = image_file::parse(bytes).expect("an image");
    let mut at = match client.update_begin(&image.header_bytes).ok()? {
        Ok(at) => at.expect("it takes images") as usize,
        Err(refusal) => return Some(Err(refusal)),
    };
    while at < image.payload.len() {
        let piece = image.payload[at..]
            .iter()
            .take(MAX_PIECE)
            .copied()
            .collect();
        match client.update_piece(at as u32, piece).ok()? {
            Ok(next) => at = next as usize,
            Err(refusal) => return Some(Err(refusal)),
        }
    }
    client.update_end().ok()
}

/// Waits until no image is on trial any more: what runs then.
fn at_rest(rig: &mut PicoRig) -> (Client, ImageInfo) {
    let begun = Instant::now();
    loop {
        let answer = patience(rig, Duration::from_secs(5));
        // It may start anew meanwhile.
        if let Ok(mut client) = Client::with_patience(rig.connect(), Patience { answer, tries: 1 })
            && let Ok(Some(info)) = client.image()
            && info.latest != UpdateState::Trial
        {
            return (client, info);
        }
        assert!(begun.elapsed() < PATIENCE, "the trial does not end");
    }
}

/// Cycles from the first reset to the image, which lights the same light as the boot loader.
fn start_cycles(rig: &mut PicoRig) -> u64 {
    let outputs = rig.emulator().outputs();
    let is_lit = |of: &&EmulatedOutput| of.pin == STATUS_LIGHT && of.level;
    let image = outputs.iter().filter(is_lit).nth(1).expect("it starts");
    image.cycle - rig.emulator().time().began
}

/// What became of images, as the journal tells it.
fn told(client: &mut Client) -> Vec<UpdateState> {
    let (_, _, records) = pulled(client);
    let what = records.iter().filter_map(|of| match of {
        Record::Update { what, .. } => Some(*what),
        _ => None,
    });
    what.collect()
}

/// A signed image comes, is tried at the next start and confirmed; what is wrong with one is named, and
/// what runs stays. The journal tells it, and a head names the image. Then the same with the power cut while the boot
/// loader begins the trial: an image runs.
#[test]
fn a_signed_image_is_tried_and_confirmed() {
    let Some((mut rig, b)) = running() else {
        return;
    };
    let mut client = host(&mut rig);
    let cycles = start_cycles(&mut rig);
    println!("verified and started in {cycles} cycles");
    assert!(cycles < START_CYCLES, "{cycles}");
    let info = client.image().unwrap().unwrap();
    assert_eq!(
        (info.version, info.counter, info.place, info.confirmed),
        ([1, 0, 0], 1, ImagePlace::A, true)
    );
    // What it tells of itself is what was signed, not what it was compiled as.
    assert_eq!(client.identity().unwrap().firmware, "1.0.0");
    let begin = |client: &mut Client, bytes: &[u8]| {
        let header = image_file::parse(bytes).unwrap().header_bytes;
        client.update_begin(&header).unwrap()
    };
    for (bad, why) in [
        (
            signed(&secret(9), "b", [1, 1, 0], 2, &b),
            UpdateRefusal::Signature,
        ),
        (
            signed(&maker(), "a", [1, 1, 0], 2, &b),
            UpdateRefusal::Board,
        ),
        (
            signed(&maker(), "b", [0, 9, 0], 2, &b),
            UpdateRefusal::Rollback,
        ),
        (
            signed(&maker(), "b", [1, 1, 0], 0, &b),
            UpdateRefusal::Rollback,
        ),
    ] {
        assert_eq!(begin(&mut client, &bad).unwrap_err(), why);
    }
    let new = signed(&maker(), "b", [1, 1, 0], 2, &b);
    cut(&mut rig, Some(MANY));
    assert_eq!(send(&mut client, &new), Some(Ok(())));
    drop(client);
    let (mut client, info) = at_rest(&mut rig);
    let writes = MANY - cut(&mut rig, None).expect("it counts");
    assert_eq!(
        (info.version, info.counter, info.place, info.latest),
        ([1, 1, 0], 2, ImagePlace::B, UpdateState::Confirmed)
    );
    assert_eq!(
        told(&mut client),
        [UpdateState::Trial, UpdateState::Confirmed]
    );
    let head = head(&mut client, [1; 32], PATIENCE).unwrap().unwrap();
    let sha512 = image_file::parse(&new).unwrap().header.sha512;
    assert_eq!(head.image[..], sha512[..32]);
    assert_eq!(head.firmware, "1.1.0");
    assert_eq!(client.identity().unwrap().firmware, "1.1.0");
    drop(client);
    rig.power_cycle();
    let (_, info) = at_rest(&mut rig);
    assert_eq!((info.version, info.place), ([1, 1, 0], ImagePlace::B));
    drop(rig);
    let _ = cut_and_go_on(&new, writes, [5]);
}

/// What is never run, or hangs, may be short: each start hashes all of it, and a line carries it.
const SHORT: usize = 16_384;

/// The beginning of an image for place B whose reset handler is an endless loop.
fn hangs(payload: &[u8]) -> Vec<u8> {
    let mut payload = payload[..SHORT].to_vec();
    let at = SHORT - 4;
    let entry = PLACE_B + (IMAGE_HEADER + at) as u32;
    payload[BEFORE_CODE + 4..][..4].copy_from_slice(&(entry | 1).to_le_bytes());
    payload[at..at + 2].copy_from_slice(&0xE7FE_u16.to_le_bytes());
    payload
}

/// A signed image that hangs at its first instruction is given up by the watchdog that the boot loader has
/// started: the one before runs again, and the journal tells it.
#[test]
fn an_image_that_hangs_is_given_up() {
    let Some((mut rig, b)) = running() else {
        return;
    };
    let mut client = host(&mut rig);
    let bad = signed(&maker(), "b", [1, 1, 0], 2, &hangs(&b));
    assert_eq!(send(&mut client, &bad), Some(Ok(())));
    drop(client);
    let (mut client, info) = at_rest(&mut rig);
    assert_eq!(
        (info.version, info.counter, info.place, info.latest),
        ([1, 0, 0], 1, ImagePlace::A, UpdateState::Reverted)
    );
    assert_eq!(
        told(&mut client),
        [UpdateState::Trial, UpdateState::Reverted]
    );
}

/// One bit of an image is changed in its place, of its signature or its code: it does not run. The other one does,
/// where one is right; else nothing, and the light says so.
#[test]
fn what_was_changed_at_rest_does_not_run() {
    let Some((a, b)) = skip_without(payload("a").and_then(|a| Ok((a, payload("b")?)))) else {
        return;
    };
    let first = signed(&maker(), "a", [1, 0, 0], 1, &a[..SHORT]);
    let second = signed(&maker(), "b", [1, 1, 0], 1, &b);
    let mut of_signature = first.clone();
    of_signature[150] ^= 1;
    let mut rig = board(&of_signature, &second).unwrap();
    assert_eq!(at_rest(&mut rig).1.place, ImagePlace::B);
    drop(rig);
    let mut first = first;
    first[10_000] ^= 1;
    let foreign = signed(&secret(9), "b", [1, 1, 0], 1, &b[..SHORT]);
    for second in [&[][..], &foreign] {
        let mut rig = board(&first, second).unwrap();
        let mut lit = 0;
        rig.wait_until("the light", |emulator| {
            lit += emulator.outputs().iter().filter(|of| of.level).count();
            lit > 5
        });
        assert!(!rig.emulator().state().is_configured);
    }
}

/// Of writes that an update takes, up to its confirmation.
const MANY: u64 = 1_000_000;

/// Cuts the power after so many writes, or no more: how many were left.
fn cut(rig: &mut PicoRig, after: Option<u64>) -> Option<u64> {
    let answer = rig
        .emulator()
        .ask(&json!({ "do": "flash_cut", "after": after }));
    answer["left"].as_u64()
}

/// The power goes within the write of an update that these are left behind, of so many: one is the last that confirms
/// it. What starts is the image before or the new one, whole, and is the new one in the end. How often it was the one
/// before.
fn cut_and_go_on(new: &[u8], writes: u64, left: impl IntoIterator<Item = u64>) -> u32 {
    let mut kept = 0;
    for left in left {
        let (mut rig, _) = running().expect("it ran before");
        let mut client = host(&mut rig);
        cut(&mut rig, Some(writes - left.min(writes)));
        let _ = send(&mut client, new);
        drop(client);
        rig.wait_until("the cut", |emulator| {
            emulator.state().json["is_on"] == false
        });
        rig.emulator().power(true);
        let (mut client, info) = at_rest(&mut rig);
        let is_new = info.version == [1, 1, 0];
        let one = if is_new {
            ([1, 1, 0], 2)
        } else {
            ([1, 0, 0], 1)
        };
        assert_eq!((info.version, info.counter), one, "{left} of {writes}");
        kept += u32::from(!is_new);
        if !is_new {
            assert_eq!(send(&mut client, new), Some(Ok(())), "{left}");
            drop(client);
            assert_eq!(at_rest(&mut rig).1.version, [1, 1, 0], "{left}");
        }
    }
    println!("{writes} writes; the image before ran {kept} times");
    kept
}

/// While pages come, and at each of the last twenty writes: among them the boot loader's and the one that confirms. By hand: `cargo test -p umi-tests --test boards long_cuts -- --ignored`.
#[test]
#[ignore = "many minutes"]
fn long_cuts_leave_an_image_that_runs() {
    let Some((mut rig, b)) = running() else {
        return;
    };
    let new = signed(&maker(), "b", [1, 1, 0], 2, &b);
    let mut client = host(&mut rig);
    cut(&mut rig, Some(MANY));
    assert_eq!(send(&mut client, &new), Some(Ok(())));
    drop(client);
    at_rest(&mut rig);
    let writes = MANY - cut(&mut rig, None).expect("it counts");
    drop(rig);
    let left = [u64::MAX, 3_000, 2_000, 1_000, 500];
    assert!(cut_and_go_on(&new, writes, left.into_iter().chain(1..=20)) > 0);
}
