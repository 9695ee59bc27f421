//! An owner's board as firmware: keys, roles, sessions, signed heads, evidence and ceilings on the
//! Cortex-M7 of QEMU and on the emulated Pico. What is the Pico's own is in [`crate::pico::owner`].

use std::time::Duration;

use umi_client::board::link::{Client, ConfigRefusal, LinkError, Patience};
use umi_client::files::key_file::SigningKey;
use umi_client::journal::verify::verify;
use umi_client::journal::{self, PullRequest, PullStep};
use umi_client::problem::Problem;
use umi_protocol::access::{AccessMode, AccessRefusal, KeyInfo, KeyName, Role};
use umi_protocol::config::{BoardConfig, LockedReading};
use umi_protocol::message::Record;
use umi_tests::cases::{clamping, job, judged, patience};
use umi_tests::rig::{PicoRig, QemuRig, Rig};

pub(crate) fn secret(of: u8) -> SigningKey {
    SigningKey::from_bytes(&[of; 32])
}

pub(crate) fn owner() -> KeyInfo {
    KeyInfo {
        public: secret(1).verifying_key().to_bytes(),
        role: Role::Owner,
        name: KeyName::new(),
    }
}

/// A host that is as patient as signatures take.
pub(crate) fn host(rig: &mut impl Rig) -> Client {
    let answer = patience(rig, Duration::from_secs(5));
    Client::with_patience(rig.connect(), Patience { answer, tries: 3 }).unwrap()
}

pub(crate) fn session(rig: &mut impl Rig) -> Client {
    let mut client = host(rig);
    assert_eq!(client.authenticate(&secret(1)).unwrap(), Role::Owner);
    client
}

/// The whole journal as a file that ends with a head, and its records.
pub(crate) fn pulled(client: &mut Client) -> (Vec<u8>, [u8; 32], Vec<Record>) {
    let wanted = PullRequest {
        head: true,
        ..PullRequest::default()
    };
    // A board whose time is slower than ours has not signed when the host stops waiting.
    for _ in 0..100 {
        let (mut items, mut records) = (Vec::new(), Vec::new());
        let pulled = journal::pull(client, wanted, |step| {
            match step {
                PullStep::Header(..) => {}
                PullStep::Gap(gap) => items.extend(gap.encode()),
                PullStep::Entry(entry, raw) => {
                    items.extend(raw);
                    records.push(journal::record(&entry).unwrap());
                }
            }
            Ok::<_, Problem>(())
        })
        .unwrap();
        if let Some(head) = pulled.head {
            let file = [&pulled.header.encode()[..], &items].concat();
            return (file, head.key, records);
        }
    }
    panic!("the board signs nothing")
}

/// A board with a jumper, which this test closes and opens.
trait Jumper: Rig {
    fn close(&mut self, is_closed: bool);
}

impl Jumper for QemuRig {
    fn close(&mut self, is_closed: bool) {
        self.close_jumper(is_closed);
    }
}

impl Jumper for PicoRig {
    fn close(&mut self, is_closed: bool) {
        self.close_jumper(is_closed);
    }
}

#[test]
fn the_image_in_qemu_has_an_owner() {
    if let Some(mut rig) = QemuRig::start_with_a_key([0x5E; 32]) {
        has_an_owner(&mut rig);
    }
}

#[test]
fn the_picos_image_has_an_owner() {
    if let Some(mut rig) = PicoRig::start_or_skip() {
        rig.close_jumper(true);
        rig.power_cycle();
        has_an_owner(&mut rig);
    }
}

/// It is claimed with the jumper closed; strangers change nothing; the owner's session does; the
/// verdict is signed; and all of that outlives the power.
fn has_an_owner(rig: &mut impl Jumper) {
    let mut client = host(rig);
    let access = client.access().unwrap();
    assert_eq!((access.mode, access.jumper), (AccessMode::Open, Some(true)));
    let board_key = access.board_key.unwrap();
    rig.close(false);
    let refused = client.key_enrol(&owner()).unwrap_err();
    assert!(matches!(
        refused,
        LinkError::Refused(AccessRefusal::JumperOpen)
    ));
    rig.close(true);
    assert!(client.key_enrol(&owner()).unwrap());

    let refused = client.set_job(&job()).unwrap_err();
    let needs = Role::Engineer;
    assert!(
        matches!(refused, LinkError::Refused(AccessRefusal::KeyNeeded { needs: of }) if of == needs)
    );
    let refused = client.authenticate(&secret(2)).unwrap_err();
    assert!(matches!(
        refused,
        LinkError::Refused(AccessRefusal::KeyUnknown)
    ));
    drop(client);

    let mut client = session(rig);
    assert_eq!(client.proven_board(), Some(&board_key));
    client.set_job(&job()).unwrap().unwrap();
    rig.control_sends(clamping(0).as_bytes());
    judged(rig, &mut client, 1);
    let (file, key, records) = pulled(&mut client);
    assert_eq!(key, board_key);
    assert!(verify(&file, Some(board_key), None).unwrap().signed);
    assert!(records.iter().any(|of| matches!(of, Record::Verdict(_))));
    let told = |of: &Record| matches!(of, Record::AccessRefused { .. });
    assert!(records.iter().any(told));
    let mut forged = file.clone();
    let at = file.len() / 2;
    forged[at] ^= 1;
    assert!(verify(&forged, Some(board_key), None).is_err());

    // The owner's ceilings, and the lock.
    let mut narrow = BoardConfig::default();
    narrow.ceilings.rms_mm = Some(1e-6);
    let refused = client.set_config(&narrow).unwrap();
    assert!(matches!(refused, Err(ConfigRefusal::Job(_))), "{refused:?}");
    let mut closed = BoardConfig::default();
    closed.access.locked_reading = LockedReading::Nobody;
    client.set_config(&closed).unwrap().unwrap();
    assert!(client.lock(true).unwrap());
    drop(client);
    rig.close(false);
    rig.power_cycle();

    let mut client = session(rig);
    let access = client.access().unwrap();
    assert_eq!(
        (access.mode, access.jumper),
        (AccessMode::Locked, Some(false))
    );
    assert_eq!(access.board_key, Some(board_key));
    let refused = client.set_job(&job()).unwrap_err();
    assert!(matches!(refused, LinkError::Refused(AccessRefusal::Locked)));
    let unread = client.job().unwrap_err();
    assert!(matches!(unread, LinkError::Refused(AccessRefusal::Locked)));
    assert!(client.lock(false).unwrap());
    let refused = client.wipe().unwrap_err();
    assert!(
        matches!(refused, LinkError::Refused(AccessRefusal::JumperOpen)),
        "{refused:?}"
    );
    assert_eq!(client.job().unwrap().job, Some(job()));
    let (file, key, _) = pulled(&mut client);
    assert_eq!(key, board_key);
    assert!(verify(&file, Some(board_key), None).unwrap().signed);
}

/// Without entropy it has no key, signs nothing, and cannot be claimed.
#[test]
fn without_entropy_there_is_no_key() {
    let Some(mut rig) = QemuRig::start_or_skip() else {
        return;
    };
    rig.close_jumper(true);
    rig.power_cycle();
    let mut client = host(&mut rig);
    assert_eq!(client.access().unwrap().board_key, None);
    assert!(!client.key_enrol(&owner()).unwrap());
    assert_eq!(client.access().unwrap().mode, AccessMode::Open);
}
