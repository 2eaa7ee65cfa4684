//! Chromium, driven over the WebDriver protocol through its `chromedriver`.

use serde_json::{Value, json};
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};

/// A headless browser window with its driver; both end with it.
pub struct Browser {
    driver: Child,
    session: String,
    _profile: tempfile::TempDir,
}

impl Browser {
    /// Starts driver and browser, or says what is missing.
    pub fn start() -> Result<Self, String> {
        let present = |program: &str| {
            let mut command = Command::new(program);
            command
                .arg("--version")
                .stdout(Stdio::null())
                .stderr(Stdio::null())
                .status()
                .is_ok_and(|s| s.success())
        };
        if let Some(absent) = ["chromium", "chromedriver"].into_iter().find(|program| !present(program)) {
            return Err(format!("`{absent}` is not installed; `cargo xtask setup` installs it on Debian"));
        }
        let mut driver = Command::new("chromedriver")
            .arg("--port=0")
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .map_err(|error| error.to_string())?;
        let port = port(&mut driver).ok_or("chromedriver does not say its port")?;
        let profile = tempfile::tempdir().map_err(|error| error.to_string())?;
        let mut browser =
            Self { driver, session: format!("http://127.0.0.1:{port}/session"), _profile: profile };
        let arguments = [
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--disable-quic",
            "--no-first-run",
            "--disable-background-networking",
            "--disable-component-update",
            "--disable-sync",
            "--hide-scrollbars",
            "--window-size=1280,1000",
            &format!("--user-data-dir={}", browser._profile.path().display()),
        ];
        let capabilities = json!({"capabilities": {"alwaysMatch": {
            "browserName": "chrome",
            "goog:chromeOptions": {"args": arguments},
            "goog:loggingPrefs": {"browser": "ALL", "performance": "ALL"},
        }}});
        let opened = post(&browser.session, &capabilities);
        let id = opened["sessionId"].as_str().ok_or_else(|| format!("no session: {opened}"))?;
        browser.session = format!("{}/{id}", browser.session);
        Ok(browser)
    }

    /// Opens a file.
    pub fn open(&self, path: &Path) {
        self.post("url", json!({"url": format!("file://{}", path.display())}));
    }

    /// Runs a function body in the page and returns what it returns.
    pub fn run(&self, script: &str) -> Value {
        self.post("execute/sync", json!({"script": script, "args": []}))
    }

    /// Clicks on the first element that a selector finds, as a user would.
    pub fn click(&self, selector: &str) {
        let element = self.element(selector);
        self.post(&format!("element/{element}/click"), json!({}));
    }

    /// Types into the first element that a selector finds.
    pub fn type_into(&self, selector: &str, text: &str) {
        let element = self.element(selector);
        self.post(&format!("element/{element}/value"), json!({"text": text}));
    }

    fn element(&self, selector: &str) -> String {
        let found = self.post("element", json!({"using": "css selector", "value": selector}));
        let id = found.as_object().and_then(|object| object.values().next()).and_then(Value::as_str);
        id.unwrap_or_else(|| panic!("{selector}: {found}")).to_owned()
    }

    /// Looks like a window of this size on a display in light or dark mode.
    pub fn emulate(&self, width: u32, height: u32, dark: bool) {
        let scheme = if dark { "dark" } else { "light" };
        self.command(
            "Emulation.setEmulatedMedia",
            json!({"features": [{"name": "prefers-color-scheme", "value": scheme}]}),
        );
        let metrics =
            json!({"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 600});
        self.command("Emulation.setDeviceMetricsOverride", metrics);
    }

    /// The whole page as PNG, in base 64.
    pub fn screenshot(&self) -> String {
        let shot = self.command("Page.captureScreenshot", json!({"captureBeyondViewport": true}));
        shot["data"].as_str().unwrap_or_else(|| panic!("no picture: {shot}")).to_owned()
    }

    fn command(&self, name: &str, parameters: Value) -> Value {
        self.post("goog/cdp/execute", json!({"cmd": name, "params": parameters}))
    }

    /// What the page wrote to its console, and what went wrong in it.
    pub fn console(&self) -> Vec<String> {
        self.log("browser")
    }

    /// The addresses of everything that pages read from files asked for; not what the browser's own first page wants.
    pub fn requests(&self) -> Vec<String> {
        let address = |line: String| {
            let event: Value = serde_json::from_str(&line).ok()?;
            let sent = event["message"]["method"] == "Network.requestWillBeSent";
            let parameters = &event["message"]["params"];
            let of_a_file = parameters["documentURL"].as_str().is_some_and(|url| url.starts_with("file:"));
            (sent && of_a_file).then(|| parameters["request"]["url"].as_str().map(str::to_owned))?
        };
        self.log("performance").into_iter().filter_map(address).collect()
    }

    fn log(&self, kind: &str) -> Vec<String> {
        let entries = self.post("se/log", json!({"type": kind}));
        let entries = entries.as_array().unwrap_or_else(|| panic!("no log of {kind}: {entries}"));
        entries.iter().filter_map(|entry| entry["message"].as_str().map(str::to_owned)).collect()
    }

    fn post(&self, path: &str, body: Value) -> Value {
        post(&format!("{}/{path}", self.session), &body)
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        let _ = ureq::delete(&self.session).call(); // ends the browser
        let _ = self.driver.kill();
        let _ = self.driver.wait();
    }
}

/// The port in "ChromeDriver was started successfully on port 12345."
fn port(driver: &mut Child) -> Option<u16> {
    let lines = BufReader::new(driver.stdout.take()?).lines().map_while(Result::ok);
    lines
        .filter(|line| line.contains("successfully on port"))
        .find_map(|line| line.trim_end_matches('.').rsplit(' ').next()?.parse().ok())
}

fn post(address: &str, body: &Value) -> Value {
    let request = ureq::post(address).config().http_status_as_error(false).build();
    let answer = request.header("Content-Type", "application/json").send(&body.to_string());
    let text = answer.and_then(|mut answer| answer.body_mut().read_to_string());
    let text = text.unwrap_or_else(|error| panic!("{address}: {error}"));
    let answer: Value =
        serde_json::from_str(&text).unwrap_or_else(|error| panic!("{address}: {error}: {text}"));
    assert!(answer["value"]["error"].is_null(), "{address}: {}", answer["value"]);
    answer["value"].clone()
}
