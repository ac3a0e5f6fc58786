//! The workbench answers the browser that has its address, and nobody else.

use std::net::{Ipv4Addr, TcpStream, UdpSocket};

use fluorspar_web::{Workbench, WorkbenchOptions};
use serde_json::json;

use crate::support::{Served, run_folder};

#[test]
fn a_token_is_exchanged_for_a_cookie_that_scripts_and_sites_do_not_get() {
    let served = Served::on_run();
    let Served { port, token, .. } = &served;
    let ask =
        |target: &str| served.send(&format!("GET {target} HTTP/1.1\r\nHost: localhost:{port}\r\n"), b"");
    let welcome = ask(&format!("/?token={token}"));
    let cookie = welcome.header("set-cookie").unwrap();
    assert!(welcome.status == 303 && welcome.header("location") == Some("/"), "{}", welcome.head);
    assert!(cookie.ends_with("; Path=/; HttpOnly; SameSite=Strict") && !cookie.contains(token.as_str()));
    assert!(cookie.starts_with(&format!("fluorspar_{port}=")), "{cookie}");
    for target in
        ["/", "/?token=", "/?token=0123", "/main.js", "/api/subject", &format!("/api/subject?token={token}")]
    {
        let refused = ask(target);
        assert!(
            refused.status == 403 && refused.header("set-cookie").is_none(),
            "{target}: {}",
            refused.head
        );
        assert!(refused.text().contains("open the whole address"), "{target}");
    }
    let forged =
        format!("GET / HTTP/1.1\r\nHost: localhost:{port}\r\nCookie: fluorspar_{port}=0; other={token}\r\n");
    assert_eq!(served.send(&forged, b"").status, 403);
    assert_eq!(served.get("/").status, 200);
    assert_ne!(Served::on_run().token, *token);
}

#[test]
fn other_hosts_and_origins_are_refused() {
    let served = Served::on_run();
    let Served { port, token, cookie, .. } = &served;
    let ask = |host: &str, more: &str| {
        let head = format!("GET /?token={token} HTTP/1.1\r\nHost: {host}\r\nCookie: {cookie}\r\n{more}");
        served.send(&head, b"").status
    };
    assert_eq!(ask(&format!("127.0.0.1:{port}"), ""), 303);
    for host in ["evil.example", &format!("evil.example:{port}"), "127.0.0.1.evil.example", "192.168.0.1"] {
        assert_eq!(ask(host, ""), 403, "{host}");
    }
    let origin = |origin: &str| ask(&format!("127.0.0.1:{port}"), &format!("Origin: {origin}\r\n"));
    assert_eq!(origin(&format!("http://127.0.0.1:{port}")), 303);
    for other in ["null", "http://evil.example", "http://localhost:1", &format!("https://127.0.0.1:{port}")] {
        assert_eq!(origin(other), 403, "{other}");
    }
}

#[test]
fn every_answer_forbids_what_is_inline_or_foreign() {
    let served = Served::on_run();
    let stranger = served.send("GET / HTTP/1.1\r\nHost: evil.example\r\n", b"");
    for answer in [
        stranger,
        served.get("/"),
        served.get("/main.js"),
        served.get("/nothing"),
        served.get("/api/subject"),
    ] {
        let policy = answer.header("content-security-policy").unwrap();
        assert!(policy.starts_with("default-src 'none'; script-src 'self'; style-src 'self'"), "{policy}");
        assert!(!policy.contains("unsafe") && !policy.contains("http"), "{policy}");
        assert_eq!(answer.header("x-content-type-options"), Some("nosniff"));
        assert_eq!(answer.header("cache-control"), Some("no-store"));
        assert_eq!(answer.header("access-control-allow-origin"), None);
    }
    let page = served.get("/").text();
    for script in page.split("<script").skip(1) {
        assert!(
            script.starts_with(" type=\"module\" src=\"/") && script.contains("\"></script>"),
            "{script}"
        );
    }
    assert!(!page.contains(" style=") && !page.contains("<style") && !page.contains("javascript:"));
    assert!(!page.contains("http://") && !page.contains("https://"));
    let handlers = ["onclick", "onload", "onerror", "onchange", "oninput", "onsubmit"];
    assert!(!handlers.iter().any(|handler| page.contains(handler)));
}

#[test]
fn paths_lead_to_nothing_but_the_pages() {
    let served = Served::on_run();
    let targets = [
        "/../Cargo.toml",
        "/%2e%2e/Cargo.toml",
        "/..%2f..%2fetc/passwd",
        "//etc/passwd",
        "/etc/passwd",
        "/pages/main.js",
        "/main.js/",
        "/main.js%00",
        "/api",
        "/api/picture/..",
        "/.git/config",
        "/C:\\windows\\win.ini",
    ];
    for target in targets {
        let answer = served.get(target);
        assert!([400, 404].contains(&answer.status), "{target}: {}", answer.head);
    }
    assert_eq!(served.get("/api/picture").status, 405);
    assert_eq!(served.send(&served.head("DELETE /"), b"").status, 405);
}

#[test]
fn nothing_is_taken_in_or_written_without_the_cookie() {
    let served = Served::on_run();
    let host = format!("Host: 127.0.0.1:{}\r\nContent-Type: application/json\r\n", served.port);
    for path in ["file/a.dng", "picture", "estimate", "save"] {
        let target = format!("POST /api/photographs/{path} HTTP/1.1\r\n{host}");
        assert_eq!(served.send(&target, b"{}").status, 403, "{path}");
        let foreign = format!(
            "{}Origin: http://evil.example\r\n",
            served.head(&format!("POST /api/photographs/{path}"))
        );
        assert_eq!(served.send(&foreign, b"{}").status, 403, "{path}");
    }
    for path in ["/report.html", "/api/report", "/api/findings"] {
        assert_eq!(served.send(&format!("GET {path} HTTP/1.1\r\n{host}"), b"").status, 403, "{path}");
    }
}

#[test]
fn bodies_are_small_and_json() {
    let served = Served::on_run();
    let json = |body: &[u8]| {
        let head = format!("{}Content-Type: application/json\r\n", served.head("POST /api/picture"));
        served.send(&head, body).status
    };
    assert_eq!(json(&vec![b' '; (64 << 10) + 1]), 413);
    assert_eq!(json(b"{"), 400);
    assert_eq!(json(b"{\"capture\": \"a\", \"view\": \"developed\", \"more\": 1}"), 422);
    let form = format!("{}Content-Type: text/plain\r\n", served.head("POST /api/picture"));
    assert_eq!(served.send(&form, b"{\"capture\": \"a\", \"view\": \"developed\"}").status, 415);
}

#[test]
fn changes_name_no_files() {
    let served = Served::on_run();
    let set = [
        "view_filter.filters=[\"/etc/passwd\"]",
        "view_filter.filters=['own.csv']",
        "base=../other.toml",
        "sensor.quantum_efficiency={ csv = \"x.csv\" }",
        "analysis.mask=C:\\mask.png",
        "lens.prescription=lens.toml",
        "light.white={ name = \"it's\", spectrum = \"/home/user/x.csv\" }",
    ];
    for set in set {
        for path in ["/api/picture", "/api/toml"] {
            let mut body = json!({ "set": [set] });
            if path == "/api/picture" {
                (body["capture"], body["view"]) = ("white".into(), "developed".into());
            }
            let refused = served.post(path, &body);
            let text = refused.text();
            assert!(refused.status == 422 && text.contains("the workbench reads no files"), "{set}: {text}");
        }
    }
    // A title is no file, whatever its signs
    assert_eq!(served.post("/api/toml", &json!({ "set": ["title=Lamp 1.2 / a.csv"] })).status, 200);
}

#[test]
fn it_listens_on_this_machine_alone() {
    let served = Served::on_run();
    // The address of this machine in its network, where it has one; nothing is sent
    let socket = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0)).unwrap();
    let own = socket.connect("192.0.2.1:9").and_then(|()| socket.local_addr());
    if let Ok(own) = own.map(|address| address.ip()).map(|ip| (ip, served.port))
        && !own.0.is_loopback()
    {
        assert!(TcpStream::connect(own).is_err(), "{own:?}");
    }
    let options = WorkbenchOptions {
        subject: Some(run_folder().display().to_string()),
        port: Some(served.port),
        ..Default::default()
    };
    let error = Workbench::open(&options).err().unwrap().to_string();
    assert!(
        error.contains(&format!("⟨port={}⟩: can't listen", served.port)) && error.contains("another port"),
        "{error}"
    );
}
