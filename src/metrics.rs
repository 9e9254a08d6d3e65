//! Every Prometheus series, named once.
