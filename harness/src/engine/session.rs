//! The parent's side of one child process: ask, wait for the answer with a deadline, never hang, never leave it behind.

use super::protocol::{Done, Envelope, MAX_LINE, Outcome, Refusal, RefusalKind, Request, parse_answer};
use crate::process;
use crate::record::names::Status;
use serde::de::DeserializeOwned;
use std::fmt;
use std::io::{self, BufRead, BufReader, Read, Write};
use std::process::{Child, ChildStdin, Command, ExitStatus, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// Why a cell has no (further) figures: the status and the words for its row.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Failure {
    /// How the cell ends.
    pub status: Status,
    /// Why.
    pub reason: String,
}

impl Failure {
    /// A failure with its words.
    pub fn new(status: Status, reason: impl Into<String>) -> Self {
        Self { status, reason: reason.into() }
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.status, self.reason)
    }
}

impl From<Refusal> for Failure {
    fn from(refusal: Refusal) -> Self {
        let status = match refusal.kind {
            RefusalKind::Unavailable => Status::Unavailable,
            RefusalKind::Unsupported => Status::Unsupported,
            RefusalKind::NotConverged => Status::NotConverged,
            RefusalKind::OutOfMemory => Status::Oom,
            RefusalKind::Failed => Status::Error,
        };
        Self { status, reason: one_line(&refusal.message) }
    }
}

/// A running child. Dropping it kills the child and everything it started.
pub struct Session {
    child: Child,
    stdin: Option<ChildStdin>,
    lines: Receiver<Line>,
    messages: Arc<Mutex<Vec<u8>>>,
    next_id: u64,
    out_of_memory_kills: Option<u64>,
}

/// What arrives on a child's stdout.
enum Line {
    Whole(Vec<u8>),
    TooLong,
    End,
}

/// How much of a child's stderr is kept: its end, where the cause stands.
const KEPT_MESSAGES: usize = 4096;

/// How long a child may take to be gone after it closed its stdout.
const FAREWELL: Duration = Duration::from_secs(2);

impl Session {
    /// Starts `command` with pipes, in a process group of its own.
    ///
    /// # Errors
    /// `unavailable` where it cannot be started.
    pub fn start(mut command: Command) -> Result<Self, Failure> {
        command.env("RUST_BACKTRACE", "0"); // its message fits into a row, a backtrace does not
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
        let out_of_memory_kills = process::out_of_memory_kills();
        let mut child = command.spawn().map_err(|error| {
            let program = command.get_program().to_string_lossy();
            Failure::new(Status::Unavailable, format!("{program} cannot be started: {error}"))
        })?;
        let (stdin, stdout, stderr) = (child.stdin.take(), child.stdout.take(), child.stderr.take());
        let (Some(stdin), Some(stdout), Some(stderr)) = (stdin, stdout, stderr) else {
            unreachable!("all three streams are piped")
        };
        let (sender, lines) = sync_channel(1); // a child that floods stdout waits on its own pipe
        std::thread::spawn(move || read_lines(BufReader::new(stdout), &sender));
        let messages = Arc::new(Mutex::new(Vec::new()));
        let kept = Arc::clone(&messages);
        std::thread::spawn(move || keep_tail(stderr, &kept));
        Ok(Self { child, stdin: Some(stdin), lines, messages, next_id: 1, out_of_memory_kills })
    }

    /// Sends a request and waits for its answer, `deadline` at most. After a failure other than a refusal the child is
    /// dead.
    ///
    /// # Errors
    /// The child's own refusal, `timeout`, or what it died of.
    pub fn ask<T: DeserializeOwned>(&mut self, request: Request, deadline: Duration) -> Result<T, Failure> {
        let id = self.next_id;
        self.next_id += 1;
        let doing = request.name();
        let mut line = serde_json::to_vec(&Envelope { id, request }).expect("requests are plain data");
        line.push(b'\n');
        let Some(stdin) = &mut self.stdin else { return Err(Failure::new(Status::Error, "already ended")) };
        if stdin.write_all(&line).and_then(|()| stdin.flush()).is_err() {
            return Err(self.post_mortem(doing));
        }
        match self.lines.recv_timeout(deadline) {
            Ok(Line::Whole(line)) => match parse_answer(&line, id) {
                Ok(Outcome::Ok(answer)) => Ok(answer),
                Ok(Outcome::Error(refusal)) => Err(refusal.into()),
                Err(lie) => Err(self.end(Status::Error, lie)),
            },
            Ok(Line::TooLong) => {
                Err(self
                    .end(Status::Error, format!("answered `{doing}` with a line of over {MAX_LINE} bytes")))
            }
            Err(RecvTimeoutError::Timeout) => {
                Err(self.end(Status::Timeout, format!("no answer to `{doing}` within {deadline:.1?}")))
            }
            Ok(Line::End) | Err(RecvTimeoutError::Disconnected) => Err(self.post_mortem(doing)),
        }
    }

    /// Asks the child to end and waits a moment; what is left then is killed when the session is dropped.
    pub fn quit(mut self) {
        if self.ask::<Done>(Request::Quit, FAREWELL).is_ok() {
            self.stdin = None;
            self.wait(FAREWELL);
        }
    }

    /// Process id of the child.
    pub fn id(&self) -> u32 {
        self.child.id()
    }

    /// Kills the child for cause.
    fn end(&mut self, status: Status, reason: String) -> Failure {
        self.kill();
        Failure { status, reason }
    }

    fn kill(&mut self) {
        self.stdin = None;
        process::kill_group(self.child.id());
        let _ = self.child.kill(); // where there are no process groups
        let _ = self.child.wait();
    }

    /// The child closed its stdout or cannot be written to: finds out what happened to it.
    fn post_mortem(&mut self, doing: &str) -> Failure {
        self.stdin = None;
        let Some(status) = self.wait(FAREWELL) else {
            return self.end(Status::Error, format!("closed its output during `{doing}` and stayed"));
        };
        process::kill_group(self.child.id()); // whatever it left behind
        std::thread::sleep(Duration::from_millis(20)); // its last words may still be in the pipe
        let last_words = self.messages.lock().map(|tail| last_words(&tail)).unwrap_or_default();
        let kernel = process::out_of_memory_kills() > self.out_of_memory_kills;
        let refused =
            ["memory allocation of", "capacity overflow", "bad_alloc", "MemoryError", "ut of memory"];
        let out_of_memory = kernel || refused.iter().any(|words| last_words.contains(words));
        let reason = format!(
            "{} during `{doing}`{}",
            fate(status),
            if last_words.is_empty() { String::new() } else { format!(": {last_words}") }
        );
        Failure { status: if out_of_memory { Status::Oom } else { Status::Error }, reason }
    }

    fn wait(&mut self, limit: Duration) -> Option<ExitStatus> {
        let begin = Instant::now();
        loop {
            match self.child.try_wait() {
                Ok(Some(status)) => return Some(status),
                Ok(None) if begin.elapsed() < limit => std::thread::sleep(Duration::from_millis(2)),
                _ => return None,
            }
        }
    }
}

impl Drop for Session {
    fn drop(&mut self) {
        self.kill();
    }
}

impl Request {
    /// The word on the wire.
    pub fn name(&self) -> &'static str {
        match self {
            Request::Describe { .. } => "describe",
            Request::Prepare { .. } => "prepare",
            Request::Solve { .. } => "solve",
            Request::Update { .. } => "update",
            Request::Edit { .. } => "edit",
            Request::Frame { .. } => "frame",
            Request::OpenLoop { .. } => "open_loop",
            Request::Memory => "memory",
            Request::Quit => "quit",
        }
    }
}

/// How a process ended, in words.
fn fate(status: ExitStatus) -> String {
    #[cfg(unix)]
    if let Some(signal) = std::os::unix::process::ExitStatusExt::signal(&status) {
        return format!("killed by signal {signal}");
    }
    match status.code() {
        Some(101) => "panicked".to_owned(),
        Some(code) => format!("ended with exit code {code}"),
        None => "ended".to_owned(),
    }
}

fn read_lines(mut stdout: impl BufRead, sender: &SyncSender<Line>) {
    loop {
        let mut line = Vec::new();
        let read = (&mut stdout).take(MAX_LINE as u64 + 1).read_until(b'\n', &mut line);
        let message = match read {
            Ok(0) | Err(_) => Line::End,
            Ok(_) if line.len() > MAX_LINE => Line::TooLong,
            Ok(_) => Line::Whole(line),
        };
        let last = !matches!(message, Line::Whole(_));
        if sender.send(message).is_err() || last {
            return;
        }
    }
}

/// Drains `stderr` for good, so that the child never blocks on it, and keeps its end.
fn keep_tail(mut stderr: impl Read, kept: &Mutex<Vec<u8>>) {
    let mut block = [0; 4096];
    loop {
        let read = match stderr.read(&mut block) {
            Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
            Ok(0) | Err(_) => return,
            Ok(read) => read,
        };
        let Ok(mut tail) = kept.lock() else { return };
        tail.extend_from_slice(&block[..read]);
        let excess = tail.len().saturating_sub(KEPT_MESSAGES);
        tail.drain(..excess);
    }
}

/// The line of a child's stderr that says most: where it panicked or which allocation failed, else the last one.
fn last_words(tail: &[u8]) -> String {
    let text = String::from_utf8_lossy(tail);
    let lines: Vec<&str> = text.lines().map(str::trim).filter(|line| !line.is_empty()).collect();
    let line_with = |words: &str| lines.iter().position(|line| line.contains(words));
    one_line(&match (line_with("memory allocation of"), line_with("panicked at")) {
        (Some(at), _) => lines[at].to_owned(),
        (None, Some(at)) => lines[at..].iter().take(2).copied().collect::<Vec<_>>().join(" "),
        (None, None) => lines.last().copied().unwrap_or_default().to_owned(),
    })
}

/// Printable, on one line, of bounded length: text of foreign processes goes into tables and files.
pub fn one_line(text: &str) -> String {
    const LONGEST: usize = 400;
    let clean: String = text.chars().map(|c| if c.is_control() { ' ' } else { c }).take(LONGEST).collect();
    clean.trim().to_owned()
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use crate::engine::protocol::{Memory, Timed};

    const LONG: Duration = Duration::from_secs(20);

    /// A child that is a shell script.
    fn shell(script: &str) -> Session {
        let mut command = Command::new("sh");
        command.args(["-c", script]);
        Session::start(command).unwrap()
    }

    fn ask(script: &str) -> Result<Memory, Failure> {
        shell(script).ask(Request::Memory, LONG)
    }

    #[test]
    fn honest_answers_and_refusals_come_through() {
        let memory = ask(r#"read l; echo '{"id":1,"ok":{"peak_rss_bytes":7}}'; read l"#).unwrap();
        assert_eq!(memory.peak_rss_bytes, Some(7));
        let refused = ask(
            r#"printf '%s\n' '{"id":1,"error":{"kind":"unsupported","message":"no\nway"}}'; read l; read l"#,
        );
        assert_eq!(refused, Err(Failure::new(Status::Unsupported, "no way")));
    }

    #[test]
    fn lies_and_crashes_become_failures() {
        let reason = |script: &str| {
            let failure = ask(script).unwrap_err();
            assert_eq!(failure.status, Status::Error, "{failure}");
            failure.reason
        };
        assert!(reason("read l; echo hello; read l").contains("hello"));
        assert!(reason(r#"read l; echo '{"id":2,"ok":{}}'; read l"#).contains("request 2 instead of 1"));
        assert!(reason("read l; echo broken >&2; exit 3").ends_with("exit code 3 during `memory`: broken"));
        assert!(reason("read l; kill -9 $$").contains("killed by signal 9"));
        assert!(reason("exec >&-; sleep 100").contains("closed its output"));
        assert!(reason("exit 0").contains("exit code 0"));
    }

    #[test]
    fn a_refused_allocation_is_out_of_memory() {
        let failure = ask("read l; echo 'memory allocation of 80 bytes failed' >&2; kill -6 $$").unwrap_err();
        assert_eq!(failure.status, Status::Oom, "{failure}");
    }

    #[test]
    fn silence_is_a_timeout_and_nothing_is_left() {
        let mut session = shell("sleep 1000 & sleep 1000");
        let failure = session.ask::<Timed>(Request::Memory, Duration::from_millis(100)).unwrap_err();
        assert_eq!(failure.status, Status::Timeout);
        let group = rustix::process::Pid::from_raw(session.id() as i32).unwrap();
        drop(session);
        let gone = (0..200).any(|_| {
            std::thread::sleep(Duration::from_millis(10));
            rustix::process::test_kill_process_group(group).is_err()
        });
        assert!(gone, "the grandchild still runs");
    }

    #[test]
    fn floods_neither_hang_nor_fill_memory() {
        assert!(ask("yes").unwrap_err().reason.contains("does not know"));
        assert!(ask("cat /dev/zero").unwrap_err().reason.contains("over"));
        let quiet = ask(r#"read l; yes >&2 & sleep 0.2; echo '{"id":1,"ok":{}}'; read l"#);
        assert_eq!(quiet, Ok(Memory::default()));
    }
}
