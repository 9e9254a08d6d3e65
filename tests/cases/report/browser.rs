//! Chromium without a screen, where it is installed. `LODESTONE_REQUIRE_CHROMIUM=1`
//! makes its absence a failure.

use std::path::Path;
use std::process::Command;

/// What the browser made of a page.
pub struct Seen {
    /// The document after all scripts ran.
    pub dom: String,
    /// What was said on its console.
    pub console: Vec<String>,
}

const PROGRAMS: [&str; 3] = ["chromium", "chromium-browser", "google-chrome"];

/// Whether there is a browser to test with.
pub fn program() -> Option<&'static str> {
    let answers =
        |program: &&str| Command::new(program).arg("--version").output().is_ok_and(|o| o.status.success());
    let found = PROGRAMS.into_iter().find(answers);
    if found.is_none() {
        let required = std::env::var_os("LODESTONE_REQUIRE_CHROMIUM").is_some_and(|value| value == "1");
        assert!(!required, "LODESTONE_REQUIRE_CHROMIUM=1, but there is none of {PROGRAMS:?}");
        eprintln!("no Chromium: the test of charts in a browser is left out");
    }
    found
}

/// Opens a page in a window of this width, in the light or the dark.
pub fn open(program: &str, markup: &str, extension: &str, width: u32, dark: bool) -> Seen {
    let folder = tempfile::tempdir().unwrap();
    let page = folder.path().join("page").with_extension(extension);
    std::fs::write(&page, markup).unwrap();
    // A sandbox is not to be had for root, nor in most containers; the page is ours.
    let output = Command::new(program)
        .args(["--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-dev-shm-usage"])
        .args(["--enable-logging=stderr", "--dump-dom", "--virtual-time-budget=10000"])
        .arg(format!("--window-size={width},1000"))
        .arg(format!("--blink-settings=preferredColorScheme={}", if dark { 0 } else { 1 }))
        .arg(format!("--user-data-dir={}", profile(folder.path())))
        .arg(format!("file://{}", page.display()))
        .output()
        .unwrap();
    let log = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{program} ended with {}:\n{log}", output.status);
    let console = log.lines().filter(|line| line.contains(":CONSOLE")).map(str::to_string).collect();
    Seen { dom: String::from_utf8_lossy(&output.stdout).into_owned(), console }
}

/// What `look.js` saw on a page: faults of its layout, what is drawn, colours.
pub fn look(program: &str, page: &str, width: u32, dark: bool) -> serde_json::Value {
    let script = format!("<script>{}</script></body>", include_str!("look.js"));
    let seen = open(program, &page.replace("</body>", &script), "html", width, dark);
    assert!(seen.console.is_empty(), "{:?}", seen.console);
    let (_, after) = seen.dom.split_once("id=\"seen\">").expect("what the script saw");
    serde_json::from_str(after.split_once("</script>").expect("its end").0).unwrap()
}

fn profile(folder: &Path) -> String {
    folder.join("profile").display().to_string()
}
