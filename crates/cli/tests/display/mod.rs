//! An X server without a screen (the program Xvfb), for tests that open windows.

use std::io::Read;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Longest time to wait until the server accepts clients, or until a window appears.
const PATIENCE: Duration = Duration::from_secs(90);

/// An X server without a screen, which ends when this value is dropped.
pub struct Display {
    server: Child,
    name: String,
}

impl Display {
    /// Starts the server, and waits until it accepts clients.
    pub fn start() -> Display {
        // The server finds a free display number itself, and prints it.
        let mut server = Command::new("Xvfb")
            // Without -noreset the server restarts whenever its last client leaves, and refuses clients meanwhile.
            .args(["-displayfd", "1", "-noreset", "-screen", "0", "1280x1024x24", "-nolisten", "tcp"])
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("cannot start Xvfb, which setup.sh --tests installs");
        let mut said = server.stdout.take().unwrap();
        let mut number = String::new();
        while !number.ends_with('\n') {
            let mut byte = [0];
            assert_eq!(said.read(&mut byte).unwrap(), 1, "Xvfb does not start");
            number.push(byte[0].into());
        }
        let display = Display { server, name: format!(":{}", number.trim()) };
        // The server prints its number a moment before it accepts clients.
        let answers = || {
            let asked = Command::new("xdotool").arg("getdisplaygeometry").env("DISPLAY", &display.name).output();
            asked.expect("cannot run xdotool, which setup.sh --tests installs").status.success()
        };
        let begun = Instant::now();
        while !answers() {
            assert!(begun.elapsed() < PATIENCE, "Xvfb accepts no clients");
            std::thread::sleep(Duration::from_millis(20));
        }
        display
    }

    /// The value of the variable `DISPLAY` for programs whose windows this server shows.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// A command that starts the program `palpate` with these arguments; this server shows the program's windows.
    pub fn program(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_palpate"));
        command.args(arguments).env("DISPLAY", &self.name).env_remove("WAYLAND_DISPLAY");
        // The program uses no input method and no other display.
        command.env("XMODIFIERS", "@im=none").stdout(Stdio::piped()).stderr(Stdio::piped());
        command
    }

    /// Runs xdotool, and returns what it prints.
    pub fn xdotool(&self, arguments: &[&str]) -> String {
        let output = Command::new("xdotool").args(arguments).env("DISPLAY", &self.name).output();
        let output = output.expect("cannot run xdotool, which setup.sh --tests installs");
        assert!(output.status.success(), "xdotool {arguments:?} failed: {}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap().trim().into()
    }

    /// Waits for the window with this title; returns its id.
    pub fn window(&self, title: &str, program: &mut Child) -> String {
        let begun = Instant::now();
        loop {
            let found = Command::new("xdotool").args(["search", "--name", title]).env("DISPLAY", &self.name).output();
            let ids = String::from_utf8(found.unwrap().stdout).unwrap();
            if let Some(id) = ids.lines().next() {
                return id.into();
            }
            if let Some(status) = program.try_wait().unwrap() {
                let mut text = String::new();
                program.stderr.take().unwrap().read_to_string(&mut text).unwrap();
                panic!("the program ended before its window appeared, with {status} and the errors: {text}");
            }
            assert!(begun.elapsed() < PATIENCE, "the window did not appear");
            std::thread::sleep(Duration::from_millis(50));
        }
    }
}

impl Drop for Display {
    fn drop(&mut self) {
        // The server is asked to end and not killed, so that it removes its socket and lock, and its number is free
        // again.
        let _ = Command::new("kill").arg(self.server.id().to_string()).status();
        let _ = self.server.wait();
    }
}
