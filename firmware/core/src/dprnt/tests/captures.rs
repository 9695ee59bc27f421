use super::support::*;
use std::println;

#[test]
fn smoke() {
    for text in [&b"SPHERE1\n***\n2\n*-135.0190*-136.6200*148.6090\n - 122.3130 - 136.6200 135.9090\n***\n"[..]] {
        let seen = run(&config(&[block()]), text);
        for l in &seen.log { println!("{l}"); }
        println!("{:?}", seen.counters);
    }
}
