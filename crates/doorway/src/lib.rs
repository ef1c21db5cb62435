//! The door of every server of this program: how many clients it takes, for how long they may do nothing, and who they are.

mod callers;
mod http;
mod limit;

pub use callers::{check_caller, is_this_computer};
pub use http::serve_http;
pub use limit::Doorway;
