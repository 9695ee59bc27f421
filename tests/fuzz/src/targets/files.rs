//! Files that people and other programs give to `umi`: jobs, configurations, heads, keys and images.
//! The first byte says which; those behind it are the file. No panic; and what is read is written
//! and read again the same.

use umi_client::files::{config_file, head_file, image_file, job_file, key_file};
use umi_core::job::check;
use umi_protocol::job::Job;
use umi_protocol::job::before::{GROWN, widen};

/// One input.
pub fn one(data: &[u8]) {
    let Some((kind, file)) = data.split_first() else {
        return;
    };
    let text = String::from_utf8_lossy(file);
    match kind % 7 {
        0 => {
            if let Ok(job) = job_file::parse(&text) {
                let Ok(written) = job_file::write(&job) else {
                    panic!("a job that is right can be written");
                };
                let again = job_file::parse(&written);
                assert_eq!(again.map_err(|fault| fault.message), Ok(job));
            }
        }
        1 => {
            if let Ok(config) = config_file::parse(&text) {
                let again = config_file::parse(&config_file::text(&config));
                assert_eq!(again.map_err(|refused| refused.message), Ok(config));
            }
        }
        2 => {
            let (field, value) = text.split_once('=').unwrap_or((&text, ""));
            if let Ok(config) = config_file::set(&Default::default(), field, value) {
                assert!(config.check().is_ok());
            }
        }
        3 => {
            if let Some(head) = head_file::parse(&text) {
                assert_eq!(head_file::parse(&head_file::text(&head)), Some(head));
            }
        }
        4 => {
            if let Some(key) = key_file::parse_public(&text) {
                let again = key_file::public_text(&key).ok();
                assert_eq!(
                    again.and_then(|text| key_file::parse_public(&text)),
                    Some(key)
                );
            }
        }
        5 => {
            if let Ok(image) = image_file::parse(file) {
                assert_eq!([&image.header_bytes[..], &image.payload].concat(), file);
            }
        }
        // As a board of before has kept it, and as a host sends it: a board checks it again.
        _ => {
            let mut kept = [file, &[0; GROWN]].concat();
            if let Some(len) = widen(&mut kept, file.len()) {
                assert!(len == file.len() || len == kept.len());
            }
            if let Ok((job, _)) = postcard::take_from_bytes::<Job>(file)
                && check(&job).is_ok()
            {
                let _ = job_file::write(&job);
            }
        }
    }
}
