//! Tests of the Haply device (`mod.rs`) against a fake of Haply's Inverse service, which sends *frames* (JSON texts
//! with the device's state) and takes messages with forces. The fake goes wrong here: it falls silent, sends garbage or
//! floods of frames, closes connections, or does not run at all.

use std::net::TcpListener;
use std::time::{Duration, Instant};

use glam::DVec3;
use palpate::scene::HaplyService;

use super::fake::{Act, Fake, frame, resting};
use super::tests::{device, force, last_force, ms, opened, tick_until, wait_until};
use super::*;

/// A script of the fake service: of the first connection it leaves the messages from number `first` on unanswered for
/// the time `lasting`; it answers all other messages.
fn silence(first: usize, lasting: Duration) -> impl Fn(usize, usize) -> Act + Send + Sync {
    let began = std::sync::OnceLock::<Instant>::new();
    move |connection, number| {
        let silent = connection == 0 && number >= first && began.get_or_init(Instant::now).elapsed() < lasting;
        if silent { Act::Silence } else { Act::Reply(resting()) }
    }
}

#[test]
fn a_silent_service_is_lost_gets_zeros_and_recovers() {
    let fake = Fake::start(silence(100, ms(300)));
    let mut device = opened(&fake);
    tick_until(&mut device, DVec3::X, |reading| matches!(reading, Err(Fault::Lost(why)) if why.contains("silent")));
    let swallowed = fake.heard().len();
    tick_until(&mut device, DVec3::X, |reading| reading.is_ok());
    let heard = fake.heard();
    assert!(heard.len() > swallowed, "messages of zero force must be sent during the silence");
    // Every message after the first unanswered one has zero force, until the service answers again.
    assert!(
        heard[101..=swallowed].iter().all(|h| force(h) == DVec3::ZERO),
        "every message must have zero force: {:?}",
        &heard[101..=swallowed]
    );
    tick_until(&mut device, DVec3::X, |_| last_force(&fake) == DVec3::X);
    assert_eq!(device.counts().connections, 1);
}

#[test]
fn a_service_that_stalls_and_then_answers_all_is_caught_up_with() {
    let script = |_, n| if n == 50 { Act::Late(ms(300), resting()) } else { Act::Reply(resting()) };
    let fake = Fake::start(script);
    let mut device = opened(&fake);
    tick_until(&mut device, DVec3::X, |reading| reading.is_err());
    tick_until(&mut device, DVec3::X, |reading| reading.is_ok());
    tick_until(&mut device, DVec3::X, |_| last_force(&fake) == DVec3::X);
    // All frames that the service has sent up to now are read within 5 s, however busy the machine is.
    let (sent, begun) = (fake.sent(), Instant::now());
    while (device.counts().frames as usize) < sent {
        assert!(
            begun.elapsed() < ms(5000),
            "only {} of the {sent} frames that were sent were read within 5 s",
            device.counts().frames
        );
        tick_until(&mut device, DVec3::X, |_| true);
    }
    assert_eq!(device.counts().connections, 1);
}

#[test]
fn a_service_silent_for_long_is_connected_to_anew() {
    let fake = Fake::start(silence(20, Duration::MAX));
    let mut device = opened(&fake);
    tick_until(&mut device, DVec3::X, |reading| reading.is_err());
    tick_until(&mut device, DVec3::X, |reading| reading.is_ok());
    assert_eq!(device.counts().connections, 2);
    let first: Vec<_> = fake.heard().into_iter().filter(|h| h.connection == 0).collect();
    assert_eq!(first.last().map(force), Some(DVec3::ZERO));
}

#[test]
fn a_garbled_frame_is_passed_over_and_several_are_a_fault() {
    let garbage = ["hello", r#"{"inverse3":"#, r#"{"inverse3":[{"device_id":"A"}]}"#, r#"{"inverse3":[7]}"#];
    let far = frame("A", [0.0, 0.0, 3.0], [0.0; 3]);
    let script = move |_, n: usize| match n {
        10..14 => Act::Reply(garbage[n - 10].into()),
        100..140 => Act::Reply(far.clone()),
        _ => Act::Reply(resting()),
    };
    let fake = Fake::start(script);
    let mut device = opened(&fake);
    tick_until(&mut device, DVec3::X, |reading| {
        // Four garbled (malformed or implausible) frames in a row are no fault, and none of them is used as a reading.
        assert!(
            fake.heard().len() >= 100 || reading.as_ref().is_ok_and(|r| r.state.position.y == 2.0),
            "wrong reading: {reading:?}"
        );
        matches!(reading, Err(Fault::Garbled(why)) if why.contains("cursor_position"))
    });
    tick_until(&mut device, DVec3::X, |reading| reading.is_ok());
    assert_eq!(device.counts().garbled, 44);
    let heard = fake.heard();
    // Message 104 is answered by the fifth garbled frame in a row; all messages after that frame have zero force.
    assert!(heard[106..140].iter().all(|h| force(h) == DVec3::ZERO));
}

#[test]
fn an_oversized_message_or_one_without_text_ends_the_connection_and_another_is_made() {
    for is_binary in [false, true] {
        let large = " ".repeat(1_000_000);
        let script = move |connection, n| match (connection, n, is_binary) {
            (0, 50, true) => Act::Binary,
            (0, 50, false) => Act::Reply(large.clone()),
            _ => Act::Reply(resting()),
        };
        let fake = Fake::start(script);
        let mut device = opened(&fake);
        tick_until(&mut device, DVec3::X, |_| fake.heard().iter().any(|h| h.connection == 1 && force(h) == DVec3::X));
        assert!(device.read(0.0).is_ok());
        let counts = device.counts();
        assert_eq!((counts.connections, counts.garbled), (2, 1));
        let first: Vec<_> = fake.heard().into_iter().filter(|h| h.connection == 0).collect();
        assert_eq!(
            first.last().map(force),
            Some(DVec3::ZERO),
            "the last force must be zero (binary message: {is_binary})"
        );
        assert_eq!(first.len(), 52);
    }
}

#[test]
fn a_service_that_hangs_up_is_lost_and_found_again_where_the_device_was() {
    let script = |connection, n| if connection < 2 && n == 30 { Act::HangUp } else { Act::Reply(resting()) };
    let fake = Fake::start(script);
    let mut device = opened(&fake);
    for connections in [2, 3] {
        tick_until(&mut device, DVec3::X, |reading| matches!(reading, Err(Fault::Lost(_))));
        tick_until(&mut device, DVec3::X, |reading| reading.is_ok());
        assert_eq!(device.counts().connections, connections);
    }
    assert_eq!(device.read(0.0).unwrap().state.position, DVec3::new(1.0, 2.0, 3.0));
    assert_eq!(device.counts().garbled, 0);
    let starts = fake.heard().into_iter().filter(|h| h.message.get("session").is_some());
    assert!(starts.map(|h| force(&h)).eq([DVec3::ZERO; 3]));
}

#[test]
fn another_machine_is_refused_unless_trusted_and_so_is_a_rate_beyond_bounds() {
    for (url, rate, word) in [("ws://192.0.2.1:10001", 1000.0, "trusted"), ("ws://127.0.0.1:1", 5000.0, "4000")] {
        let mut device = Haply::new(Settings {
            service: HaplyService { url: url.into(), ..HaplyService::default() },
            rate,
            ..Settings::default()
        });
        assert!(
            matches!(device.open(), Err(Fault::Lost(why)) if why.contains(word)),
            "address {url}, rate {rate} Hz: opening must be refused"
        );
        assert_eq!(device.counts().connections, 0);
    }
}

#[test]
fn nobody_there_or_nothing_plugged_in_is_said_with_a_remedy() {
    let free = TcpListener::bind("127.0.0.1:0").unwrap();
    let url = format!("ws://{}", free.local_addr().unwrap());
    // The address is that of a port that accepts connections and never answers.
    let mut mute = Haply::new(Settings {
        service: HaplyService { url: url.clone(), ..HaplyService::default() },
        ..Settings::default()
    });
    assert!(
        matches!(mute.open(), Err(Fault::Lost(why)) if why.contains(&url) && why.contains("start the Inverse service"))
    );
    drop(free);
    let mut nobody = Haply::new(Settings {
        service: HaplyService { url: url.clone(), ..HaplyService::default() },
        ..Settings::default()
    });
    assert!(matches!(nobody.open(), Err(Fault::Lost(why)) if why.contains(&url) && why.contains("refused")));
    let empty = Fake::with(None, r#"{"inverse3":[]}"#.into(), |_, _| Act::Silence);
    assert!(matches!(device(&empty).open(), Err(Fault::Lost(why)) if why.contains("plug the device in")));
    assert!(empty.heard().is_empty(), "no message may be sent if the service lists no device");
}

#[test]
fn frames_that_nobody_asked_for_are_dropped_and_a_flood_ends_the_connection() {
    let script = |connection, n| match (connection, n) {
        (0, 40) => Act::Flood(3, resting()),
        (0, 200) => Act::Flood(1000, resting()),
        _ => Act::Reply(resting()),
    };
    let fake = Fake::start(script);
    let mut device = opened(&fake);
    wait_until("100 messages", || fake.heard().len() > 100);
    assert_eq!(device.counts().connections, 1);
    tick_until(&mut device, DVec3::X, |reading| matches!(reading, Err(Fault::Garbled(_)) | Err(Fault::Lost(_))));
    tick_until(&mut device, DVec3::X, |reading| reading.is_ok());
    assert_eq!(device.counts().connections, 2);
}

#[test]
fn a_service_that_falls_ever_further_behind_is_connected_to_anew() {
    let script = |connection, _| if connection == 0 { Act::Late(ms(200), resting()) } else { Act::Reply(resting()) };
    let fake = Fake::start(script);
    let mut device = opened(&fake);
    tick_until(&mut device, DVec3::X, |_| fake.heard().iter().any(|h| h.connection == 1 && force(h) == DVec3::X));
    assert_eq!(device.counts().connections, 2);
}
