//! The fuses of an RP2350 (its OTP) that make it run nobody else's images: as a file for who burns them. Nothing here does.

use k256::ecdsa::SigningKey;
use serde_json::{Value, json};
use sha2::{Digest as _, Sha256};

use super::block;

/// What `picotool otp load` takes.
pub fn settings(key: &SigningKey) -> Value {
    let hash = Sha256::digest(block::public(key));
    json!({
        "boot_flags1": { "key_valid": 1, "key_invalid": 0b1110 },
        "bootkey0": hash.as_slice(),
        "crit1": { "secure_boot_enable": 1 },
    })
}

/// What each of them does, for a person.
pub const IN_WORDS: &str = "\
pico2-otp.json has settings for the fuses (OTP) of a Pico 2. No command of openumi burns a fuse.

A fuse that is burned stays burned. Whoever burns these and loses KEY.boot.pem has a board that
takes no image any more. Nobody has tried them on a board. So, in this order:

1. Run the signed image on the board without them, update it, and update it again.
2. Keep KEY and KEY.boot.pem at two places.
3. With the board in BOOTSEL mode, by hand:  picotool otp load pico2-otp.json
   It burns at once, without a question.
4. picotool reboot, and look whether the board still starts.

bootkey0            The SHA-256 of the public key of KEY.boot.pem. The boot ROM compares the key in
                    an image with it.
boot_flags1
  key_valid 1       bootkey0 is a key.
  key_invalid 14    The three other places for keys never hold one. Without it, who holds the board
                    in BOOTSEL mode burns a key of their own.
crit1
  secure_boot_enable 1
                    The boot ROM starts only what such a key has signed: pico2.uf2 and the self-test
                    do not start any more. The RISC-V cores are off.

What the boot ROM burns by itself then, one fuse each time: the counter of an image
(`--counter`, 1 to 47), when an image with a higher one is confirmed, or starts from pico2-signed.uf2.
Nothing with a lower counter starts any more. It also burns ROLLBACK_REQUIRED the first time.

What pico2-otp.json leaves as it is, and why:

crit1.debug_disable             Whoever reaches the debug pads reads and changes the running board, also with
                                secure boot. Burning it ends every repair by a probe.
crit1.glitch_detector_enable    Makes a disturbed supply restart the board: measure that in the cabinet first.
boot_flags0.disable_bootsel_usb_*    BOOTSEL is the only way back if both images are damaged.

What no fuse gives: the flash beside the chip can be read by anybody who opens the board, with the
board's own key in it. Ways to run other code by disturbing the supply, the clock or light on the chip
were published in 2024 and 2025.
";
