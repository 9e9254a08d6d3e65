//! The pages of the daemon, driven in a browser.
