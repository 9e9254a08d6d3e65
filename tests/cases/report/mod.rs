//! `lodestone report`: the page, and its charts as a browser lays them out.

mod browser;
mod charts;
mod contrast;
mod markup;
mod measured;
mod sample;
