//! The daemon as shipped: unit, container, alerts, proxies, viewers on other pages.

mod access;
