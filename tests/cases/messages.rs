//! What the command line, the log and the API tell.
