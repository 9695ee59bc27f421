//! Signed images on a Cortex-M7: the code by which every board takes them, over flash that is modelled,
//! with a payload of text.

use umi_client::board::link::Client;
use umi_client::files::image_file;
use umi_protocol::message::{Record, ResetReason};
use umi_protocol::program::MAX_PIECE;
use umi_protocol::update::{ImagePlace, ImageVersion, UpdateRefusal, UpdateState};
use umi_tests::rig::{QemuRig, Rig as _};

use crate::owner::{host, pulled, secret};

const MAKER: u8 = 9;
const STRANGER: u8 = 7;

fn image(by: u8, board: &str, version: ImageVersion, counter: u32, confirms: bool) -> Vec<u8> {
    let payload = format!("umi-virtual-image\nconfirms = {confirms}\n");
    // Longer than a piece and than a sector of the flash.
    let payload = payload + &"#".repeat(5000);
    let signed = image_file::sign(payload.as_bytes(), board, version, counter, &secret(by));
    signed.unwrap().1
}

/// Brings an image to its end: then the board starts anew by itself.
fn bring(client: &mut Client, image: &[u8]) -> Result<(), UpdateRefusal> {
    let (header, payload) = image.split_first_chunk().unwrap();
    let mut at = client.update_begin(header).unwrap()?.expect("slots") as usize;
    while at < payload.len() {
        let piece = payload[at..].iter().take(MAX_PIECE).copied().collect();
        at = client.update_piece(at as u32, piece).unwrap()? as usize;
    }
    client.update_end().unwrap()
}

/// What runs, and what came of the latest update, once no trial is under way.
fn running(rig: &mut QemuRig) -> (ImageVersion, ImagePlace, UpdateState, String) {
    let mut client = host(rig);
    loop {
        let info = client.image().unwrap().expect("a board that takes images");
        if info.latest != UpdateState::Trial {
            let firmware = client.identity().unwrap().firmware;
            return (info.version, info.place, info.latest, firmware.to_string());
        }
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
}

/// A signed image is verified, tried and kept, also over the power; what is wrong with one is named and
/// changes nothing; one that does not confirm itself is given up. The journal has all of it.
#[test]
fn the_core_takes_signed_images() {
    let maker = secret(MAKER).verifying_key().to_bytes();
    let Some(mut rig) = QemuRig::start_with_a_maker([0x5E; 32], maker) else {
        return;
    };
    let board = "mps2-an500";
    let built_in = running(&mut rig);
    assert_eq!(built_in.1, ImagePlace::BuiltIn);
    let mut client = host(&mut rig);
    let good = image(MAKER, board, [1, 2, 0], 3, true);
    let mut damaged = good.clone();
    *damaged.last_mut().unwrap() ^= 1;
    for (wrong, why) in [
        (
            image(STRANGER, board, [1, 2, 0], 3, true),
            UpdateRefusal::Signature,
        ),
        (
            image(MAKER, "pico-a", [1, 2, 0], 3, true),
            UpdateRefusal::Board,
        ),
        (damaged, UpdateRefusal::Damaged),
    ] {
        assert_eq!(bring(&mut client, &wrong), Err(why));
    }
    assert_eq!(bring(&mut client, &good), Ok(()));
    drop(client);
    assert_eq!(rig.starts_anew(), ResetReason::Software);
    let kept = (
        [1, 2, 0],
        ImagePlace::A,
        UpdateState::Confirmed,
        "1.2.0".to_owned(),
    );
    assert_eq!(running(&mut rig), kept);
    rig.power_cycle();
    assert_eq!(running(&mut rig), kept);

    let mut client = host(&mut rig);
    for (version, counter) in [([1, 1, 9], 9), ([1, 3, 0], 2)] {
        let older = image(MAKER, board, version, counter, true);
        assert_eq!(bring(&mut client, &older), Err(UpdateRefusal::Rollback));
    }
    let never = image(MAKER, board, [1, 3, 0], 4, false);
    assert_eq!(bring(&mut client, &never), Ok(()));
    drop(client);
    // To try it, and to go back.
    assert_eq!(rig.starts_anew(), ResetReason::Software);
    assert_eq!(rig.starts_anew(), ResetReason::Software);
    let (version, place, latest, _) = running(&mut rig);
    assert_eq!(
        (version, place, latest),
        ([1, 2, 0], ImagePlace::A, UpdateState::Reverted)
    );
    let mut client = host(&mut rig);
    let (_, _, records) = pulled(&mut client);
    let told: Vec<_> = records
        .iter()
        .filter_map(|record| match record {
            Record::Update { what, to, .. } => Some((*what, *to)),
            _ => None,
        })
        .collect();
    let [first, second] = [[1, 2, 0], [1, 3, 0]];
    let expected = [
        (UpdateState::Trial, first),
        (UpdateState::Confirmed, first),
        (UpdateState::Trial, second),
        (UpdateState::Reverted, second),
    ];
    assert_eq!(told, expected);
}

/// Without a maker's key it takes none, and says so.
#[test]
fn without_a_makers_key_no_image_is_taken() {
    let Some(mut rig) = QemuRig::start_with_a_key([0x5E; 32]) else {
        return;
    };
    let mut client = host(&mut rig);
    assert_eq!(client.image().unwrap(), None);
    let image = image(MAKER, "mps2-an500", [1, 2, 0], 3, true);
    let (header, _) = image.split_first_chunk().unwrap();
    assert_eq!(client.update_begin(header).unwrap(), Ok(None));
}
