//! Who may talk to the workbench: the browser to which its address was given, and nobody else on the machine or in the web.
//!
//! The address holds a token, which the first request exchanges for a cookie that no script and no other site can use. A name of
//! another host (a site that points its own name at this machine) and an origin of another site are refused before that.

use std::sync::Arc;

use axum::extract::{Request, State};
use axum::http::header::{
    CACHE_CONTROL, CONTENT_SECURITY_POLICY, COOKIE, HOST, LOCATION, ORIGIN, REFERRER_POLICY, SET_COOKIE,
    X_CONTENT_TYPE_OPTIONS,
};
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

use crate::server::Server;

/// Pages load their own scripts, styles and pictures, run nothing inline and stand in no frame.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; connect-src 'self'; \
                      base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// Headers of every answer, unless it has its own.
const HEADERS: [(HeaderName, &str); 6] = [
    (CONTENT_SECURITY_POLICY, POLICY),
    (X_CONTENT_TYPE_OPTIONS, "nosniff"),
    (REFERRER_POLICY, "no-referrer"),
    (CACHE_CONTROL, "no-store"),
    (HeaderName::from_static("cross-origin-opener-policy"), "same-origin"),
    (HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
];

/// Secrets of one workbench.
pub(crate) struct Guard {
    token: String,
    session: String,
    /// Cookies belong to a host whatever its port: each workbench of a machine has a name of its own.
    cookie: String,
}

impl Guard {
    pub(crate) fn new(port: u16) -> Self {
        let secret = || format!("{:032x}", rand::random::<u128>());
        Self { token: secret(), session: secret(), cookie: format!("fluorspar_{port}") }
    }

    pub(crate) fn token(&self) -> &str {
        &self.token
    }

    /// The answer to a request that must not go on: the exchange of the token, or a refusal.
    fn stops(&self, request: &Request) -> Option<Response> {
        let headers = request.headers();
        let host = text_of(headers, HOST);
        if !is_this_machine(host) {
            return Some(refused("this workbench answers to the names 127.0.0.1 and localhost only"));
        }
        let is_own = |origin: &str| origin.strip_prefix("http://") == Some(host);
        if headers.contains_key(ORIGIN) && !is_own(text_of(headers, ORIGIN)) {
            return Some(refused("requests of other sites are refused"));
        }
        let query = request.uri().query().unwrap_or_default();
        if let (Some(given), "/") = (query.strip_prefix("token="), request.uri().path()) {
            return Some(match same(given, &self.token) {
                true => self.welcome(),
                false => refused(WITHOUT_COOKIE),
            });
        }
        (!self.has_cookie(headers)).then(|| refused(WITHOUT_COOKIE))
    }

    fn has_cookie(&self, headers: &HeaderMap) -> bool {
        let all = headers.get_all(COOKIE).iter().filter_map(|value| value.to_str().ok());
        let mut pairs = all.flat_map(|line| line.split(';')).filter_map(|pair| pair.trim().split_once('='));
        pairs.any(|(name, value)| name == self.cookie && same(value, &self.session))
    }

    /// Gives the cookie, and leads to an address without the token.
    fn welcome(&self) -> Response {
        let Self { cookie, session, .. } = self;
        let cookie = format!("{cookie}={session}; Path=/; HttpOnly; SameSite=Strict");
        (StatusCode::SEE_OTHER, [(SET_COOKIE, cookie), (LOCATION, "/".into())]).into_response()
    }
}

const WITHOUT_COOKIE: &str = "open the whole address that `fluorspar workbench` printed, with its token";

fn text_of(headers: &HeaderMap, name: HeaderName) -> &str {
    headers.get(name).and_then(|value| value.to_str().ok()).unwrap_or_default()
}

/// Whether a host is this machine by one of its own names; ports may be forwarded.
fn is_this_machine(host: &str) -> bool {
    let name =
        host.rsplit_once(':').filter(|(_, port)| port.parse::<u16>().is_ok()).map_or(host, |(name, _)| name);
    ["127.0.0.1", "localhost"].contains(&name)
}

/// Whether two texts are the same, in a time that does not tell how far they agree.
fn same(given: &str, wanted: &str) -> bool {
    let differing = given.bytes().zip(wanted.bytes()).fold(0, |all, (a, b)| all | (a ^ b));
    given.len() == wanted.len() && differing == 0
}

fn refused(why: &str) -> Response {
    (StatusCode::FORBIDDEN, format!("Refused: {why}.\n")).into_response()
}

/// Lets a request through, or answers it; sets the headers of all answers.
pub(crate) async fn guarded(State(server): State<Arc<Server>>, request: Request, next: Next) -> Response {
    let mut response = match server.guard.stops(&request) {
        Some(answer) => answer,
        None => next.run(request).await,
    };
    for (name, value) in HEADERS {
        response.headers_mut().entry(name).or_insert(HeaderValue::from_static(value));
    }
    response
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_names_of_this_machine_pass() {
        for host in ["127.0.0.1:5000", "localhost", "localhost:80"] {
            assert!(is_this_machine(host), "{host}");
        }
        for host in
            ["", "evil.example:5000", "127.0.0.1.evil.example", "localhost:x", "127.0.0.2:1", "[::1]:5"]
        {
            assert!(!is_this_machine(host), "{host}");
        }
        assert!(same("ab", "ab") && !same("a", "ab") && !same("ab", "ac") && !same("", "ab"));
    }
}
