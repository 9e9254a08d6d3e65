//! The item POINT14 from records.

use super::super::arithmetic::ArithmeticEncoder;
use super::super::predict;
use super::*;

impl Channels {
    /// Encodes a point, and says whether its channel is another than the last one's.
    pub fn encode(
        &mut self,
        layers: &mut [ArithmeticEncoder; LAYERS],
        has: &mut [bool; LAYERS],
        point: Point14,
    ) -> bool {
        let before = self.enter(point).point;
        let next = point.channel();
        let switches = next != self.current;
        let last = match &self.channels[next] {
            Some(channel) if switches && self.used[next] => channel.point,
            _ => before,
        };
        let changes = changes_between(&last, &point) | if switches { CHANNEL_CHANGES } else { 0 };
        let channel = self.enter(point);
        layers[XY].symbol(channel.changes(), changes);
        if switches {
            let further = (next + 4 - self.current) & 3;
            layers[XY].symbol(self.enter(point).channel.get(3), further - 1);
            self.current = next;
        }
        self.enter(last).encode(changes, layers, has, point);
        switches
    }
}

/// What a point has that the last one of its channel has not; all but the channel.
fn changes_between(last: &Point14, point: &Point14) -> usize {
    let times = [last.time, point.time].map(|time| f64::from_bits(time as u64));
    // As numbers, as LASzip compares them: what is none always is another. And as bits, or
    // one zero would be taken for the other.
    let time = times[0] != times[1] || last.time != point.time;
    let number = match (point.number() + 16 - last.number()) & 15 {
        0 => 0,
        1 => 1,
        15 => 2,
        _ => 3,
    };
    let bit = |changes: bool, bit: usize| if changes { bit } else { 0 };
    bit(last.source != point.source, SOURCE_CHANGES)
        | bit(time, TIME_CHANGES)
        | bit(last.scan_angle != point.scan_angle, ANGLE_CHANGES)
        | bit(last.of_returns() != point.of_returns(), RETURNS_CHANGE)
        | number
}

impl Channel {
    /// `has` notes the layers of fields that change; the others are left out.
    fn encode(
        &mut self,
        changes: usize,
        layers: &mut [ArithmeticEncoder; LAYERS],
        has: &mut [bool; LAYERS],
        point: Point14,
    ) {
        let time_changes = changes & TIME_CHANGES != 0;
        let last = std::mem::replace(&mut self.point, point);
        let xy = &mut layers[XY];
        if changes & RETURNS_CHANGE != 0 {
            xy.symbol(self.of_returns[last.of_returns()].get(16), point.of_returns());
        }
        if changes & 3 == 3 {
            if time_changes {
                xy.symbol(self.number[last.number()].get(16), point.number());
            } else {
                let further = (point.number() + 16 - last.number()) & 15;
                xy.symbol(self.number_at_same_time.get(13), further - 2);
            }
        }
        let returns = Returns::of(&point);
        let context = returns.differences | usize::from(time_changes);

        let median = &mut self.x_differences[context];
        let difference = point.at[0].wrapping_sub(last.at[0]);
        let x_bits = self.x.encode(xy, usize::from(returns.single), median.get(), difference);
        median.add(difference);

        let median = &mut self.y_differences[context];
        let difference = point.at[1].wrapping_sub(last.at[1]);
        let y_context = predict::y_context(returns.single, x_bits);
        let y_bits = self.y.encode(xy, y_context, median.get(), difference);
        median.add(difference);

        let height = &mut self.heights[returns.height];
        let z_context = predict::z_context(returns.single, x_bits, y_bits);
        self.z.encode(&mut layers[Z], z_context, *height, point.at[2]);
        *height = point.at[2];

        has[CLASSIFICATION] |= point.classification != last.classification;
        let context = usize::from(last.classification & 31) << 1 | usize::from(returns.place == 3);
        layers[CLASSIFICATION]
            .symbol(self.classification[context].get(256), usize::from(point.classification));

        has[FLAGS] |= point.plain_flags() != last.plain_flags();
        layers[FLAGS].symbol(self.flags[last.plain_flags()].get(64), point.plain_flags());

        has[INTENSITY] |= point.intensity != last.intensity;
        let of_place = &mut self.intensities[returns.place << 1 | usize::from(time_changes)];
        let (predicted, intensity) = (i32::from(*of_place), i32::from(point.intensity));
        self.intensity.encode(&mut layers[INTENSITY], returns.place, predicted, intensity);
        *of_place = point.intensity;

        if changes & ANGLE_CHANGES != 0 {
            has[SCAN_ANGLE] = true;
            let (predicted, angle) = (i32::from(last.scan_angle), i32::from(point.scan_angle));
            self.scan_angle.encode(&mut layers[SCAN_ANGLE], usize::from(time_changes), predicted, angle);
        }
        has[USER_DATA] |= point.user_data != last.user_data;
        let model = self.user_data[usize::from(last.user_data >> 2)].get(256);
        layers[USER_DATA].symbol(model, usize::from(point.user_data));
        if changes & SOURCE_CHANGES != 0 {
            has[SOURCE] = true;
            self.source.encode(&mut layers[SOURCE], 0, i32::from(last.source), i32::from(point.source));
        }
        if time_changes {
            has[TIME] = true;
            self.times.encode(&mut layers[TIME], point.time);
        }
        self.time_changed = time_changes;
    }
}
