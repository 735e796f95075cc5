//! Where the interior point starts: values, slacks and multipliers.

use super::StructuredSolver;
use super::channel::Channel;
use super::clipping::Cuts;
use super::kernel::run;
use super::newton::Newton;
use super::solves::SolveAbsolute;

/// Weight toward the middle of the bounds in the starting solve, in units of the starting products.
const CENTERING: f64 = 10.0;

/// Least starting slack as a fraction of the bounds' distance.
const LEAST_SLACK: f64 = 0.1;

/// The same for a plan that was cut off at its bounds.
const WIDE_SLACK: f64 = 0.35;

/// Starting products as a part of multiplier times distance, averaged over the bounds that the sweeps found active; where feedback was
/// clipped, its own estimate is taken instead.
const STARTING_PART: f64 = 0.05;

/// The largest products to start from.
const MOST_PRODUCT: f64 = 1e12;

/// Growth of the cost to go along a plan from which it runs away.
const RUNAWAY: f64 = 10.0;

impl<const NX: usize, const NU: usize> Newton<NX, NU> {
    /// Whether the states at hand become far dearer, by the cost to go at hand, than the first is.
    pub(super) fn runs_away(&self) -> bool {
        let cost_to_go = |k: usize| {
            let (x, p) = (self.x(k), &self.values[k].xx);
            let column = |j: usize| x.iter().zip(&p[j]).map(|(x, p)| x * p).sum::<f64>();
            (0..NX).map(|j| x[j] * column(j)).sum::<f64>()
        };
        let most = RUNAWAY * cost_to_go(0);
        !(1..=self.n).all(|k| cost_to_go(k) <= most)
    }
}

impl<const NX: usize, const NU: usize> StructuredSolver<NX, NU> {
    /// Starting point; returns the average complementarity product and the number of products. Where soft bounds are violated that is at least what
    /// their prices make of the violations: from products of 1 where these are 1e6, no step reached a hundredth of its length.
    pub(super) fn start_interior(&mut self, cuts: &Cuts) -> (f64, f64) {
        let (part, scale) = match cuts.mean_product() {
            Some(product) => (1.0, product),
            None => {
                let product = self.mean_product(Channel::product_scale);
                (STARTING_PART, product.unwrap_or(1.0))
            }
        };
        let mu = part
            * if scale.is_finite() {
                scale.clamp(1e-6, MOST_PRODUCT)
            } else {
                1.0
            };
        // Where only inputs and rates have bounds, the clipped plan, or what the last sweep made of it, needs no more than room. Elsewhere a plan
        // that meets the bounds of states halfway is worth a solve, and where cut-off feedback runs away, one that does not.
        let least = if self.newton.weighs_states() || cuts.runs_away {
            for channel in self.newton.channels() {
                channel.center(CENTERING * mu);
            }
            run(SolveAbsolute {
                newton: &mut self.newton,
                clipped: false,
            });
            LEAST_SLACK
        } else {
            WIDE_SLACK
        };
        let priced = self.mean_product(Channel::priced_products).unwrap_or(0.0);
        let mu = mu.max(priced.min(MOST_PRODUCT));
        let mut count = 0.0;
        for channel in self.newton.channels() {
            channel.enter(least, mu);
            count += channel.count();
        }
        let x = *self.newton.x(self.newton.n);
        if let Some(cone) = &mut self.newton.cone {
            cone.start(&x, mu);
            count += cone.count();
        }
        (mu, count)
    }

    /// The mean of what sums and numbers of products `of` the channels make, if there are any.
    fn mean_product(&mut self, of: fn(&Channel) -> (f64, f64)) -> Option<f64> {
        let (mut sum, mut active) = (0.0, 0.0);
        for channel in self.newton.channels() {
            let (products, count) = of(channel);
            sum += products;
            active += count;
        }
        (active > 0.0).then(|| sum / active)
    }
}
