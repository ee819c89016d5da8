#include "fitter/diagnose/spectrum.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

namespace armtrue {
namespace {

constexpr double kLeastCycles = 0.5;
constexpr double kMostCycles = 600.0;
constexpr double kUnknownRatioCycles = 300.0;
constexpr double kWideCycles = 1200.0;
constexpr double kOversampling = 4.0;
// A line of a spectrum is accepted if noise makes one as high with less than this probability.
constexpr double kChanceOfLine = 1e-3;
constexpr double kLeastTurned = 0.2;  // [rad]
// Waves over a sliding joint's travel: from half of one to a thousand, which keeps a spectrum short
// enough to draw; no screw has a lead below 2 mm.
constexpr double kFewestWaves = 0.5, kMostWaves = 1000.0, kShortestWave = 2e-3;
constexpr double kLeastTravel = 10.0 * kShortestWave;
constexpr double kFinestGrid = 1e-5;  // [rad or m]: aliases of finer steps are out of range

// For every row: joint angle (for a sliding joint 2 pi times its position, so that cycles per metre
// take the place of cycles per turn), product of the joint's column and the residual, and that
// column's square.
struct JointSeries {
  std::vector<double> angle, product, weight;
  double range = 0.0, total = 0.0;  // range: [rad or m]
};

// The step of which all differences of `values` are multiples, by Euclid's algorithm.
double grid_of(const std::vector<double>& values) {
  double step = 0.0;
  for (const double value : values) {
    double rest = std::abs(value - values.front());
    while (rest > kFinestGrid) {
      double left = std::fmod(step, rest);
      if (rest - left < kFinestGrid) left = 0.0;
      step = std::exchange(rest, left);
    }
  }
  return step;
}

JointSeries joint_series(const Linearization& l, const State& state, int joint) {
  JointSeries series;
  const Joint& nominal = state.robot().joints[static_cast<std::size_t>(joint - 1)];
  const double scale = nominal.prismatic ? 2.0 * std::numbers::pi : 1.0;
  const auto column = l.geometry.col(l.layout.motor(joint - 1));
  const auto n = static_cast<std::size_t>(state.robot().joint_count());
  const int h = l.height;
  for (std::size_t r = 0; r < l.rows(); ++r) {
    const Eigen::Index at = static_cast<Eigen::Index>(r) * h;
    series.angle.push_back(scale * state.joints()[r * n + static_cast<std::size_t>(joint - 1)]);
    series.product.push_back(column.segment(at, h).dot(l.residual.segment(at, h)));
    series.weight.push_back(column.segment(at, h).squaredNorm());
  }
  const auto [low, high] = std::minmax_element(series.angle.begin(), series.angle.end());
  series.range = (*high - *low) / scale;
  series.total = l.residual.squaredNorm();
  return series;
}

struct Power {
  double share, amplitude;
};

Power power_from_sums(double ys, double yc, double ss, double sc, double cc, double total) {
  const double determinant = ss * cc - sc * sc;
  if (determinant <= 1e-9 * ss * cc || total <= 0.0) return {0.0, 0.0};
  const double a = (cc * ys - sc * yc) / determinant;
  const double b = (ss * yc - sc * ys) / determinant;
  return {(a * ys + b * yc) / total, std::hypot(a, b)};
}

Power power_at(const JointSeries& series, double cycles) {
  double ys = 0.0, yc = 0.0, ss = 0.0, sc = 0.0, cc = 0.0;
  for (std::size_t i = 0; i < series.angle.size(); ++i) {
    const double s = std::sin(cycles * series.angle[i]);
    const double c = std::cos(cycles * series.angle[i]);
    ys += series.product[i] * s;
    yc += series.product[i] * c;
    ss += series.weight[i] * s * s;
    sc += series.weight[i] * s * c;
    cc += series.weight[i] * c * c;
  }
  return power_from_sums(ys, yc, ss, sc, cc, series.total);
}

double cycles_by_ratio(const Joint& nominal, double resolution) {
  return std::min(kMostCycles, nominal.gear_ratio > 0.0 ? 2.0 * nominal.gear_ratio + resolution
                                                        : kUnknownRatioCycles);
}

// Lowest and highest cycles per metre of a sliding joint over `travel` [m].
std::pair<double, double> cycles_of_travel(double travel, double grid) {
  const double shortest = std::max({kShortestWave, travel / kMostWaves, 2.0 * grid});
  return {kFewestWaves / travel, 1.0 / shortest};
}

template <typename MostCycles>
std::vector<JointSpectrum> spectra_up_to(const Linearization& linearization, const State& state,
                                         const MostCycles& most_cycles) {
  std::vector<JointSpectrum> spectra;
  for (int joint = 1; joint <= state.robot().joint_count(); ++joint) {
    const Joint& nominal = state.robot().joints[static_cast<std::size_t>(joint - 1)];
    const JointSeries series = joint_series(linearization, state, joint);
    if (series.range < (nominal.prismatic ? kLeastTravel : kLeastTurned)) continue;
    JointSpectrum spectrum;
    spectrum.joint = joint;
    spectrum.slides = nominal.prismatic;
    spectrum.resolution = (nominal.prismatic ? 1.0 : 2.0 * std::numbers::pi) / series.range;
    spectrum.grid = grid_of(state.column("q" + std::to_string(joint)));
    const double step = spectrum.resolution / kOversampling;
    const auto [least, most] =
        nominal.prismatic ? cycles_of_travel(series.range, spectrum.grid)
                          : std::pair{kLeastCycles, most_cycles(nominal, spectrum.resolution)};
    if (most <= least) continue;  // a grid too coarse for any wave
    const auto lines = static_cast<std::size_t>((most - least) / step) + 1;
    // Each row's phase is rotated from line to line instead of computing new sines; double
    // precision keeps that to 1e-12.
    const std::size_t rows = series.angle.size();
    std::vector<double> s(rows), c(rows), ds(rows), dc(rows);
    for (std::size_t i = 0; i < rows; ++i) {
      s[i] = std::sin(least * series.angle[i]);
      c[i] = std::cos(least * series.angle[i]);
      ds[i] = std::sin(step * series.angle[i]);
      dc[i] = std::cos(step * series.angle[i]);
    }
    for (std::size_t line = 0; line < lines; ++line) {
      double ys = 0.0, yc = 0.0, ss = 0.0, sc = 0.0, cc = 0.0;
      for (std::size_t i = 0; i < rows; ++i) {
        ys += series.product[i] * s[i];
        yc += series.product[i] * c[i];
        ss += series.weight[i] * s[i] * s[i];
        sc += series.weight[i] * s[i] * c[i];
        cc += series.weight[i] * c[i] * c[i];
        const double turned = s[i] * dc[i] + c[i] * ds[i];
        c[i] = c[i] * dc[i] - s[i] * ds[i];
        s[i] = turned;
      }
      const Power power = power_from_sums(ys, yc, ss, sc, cc, series.total);
      spectrum.cycles.push_back(least + static_cast<double>(line) * step);
      spectrum.power.push_back(power.share);
      spectrum.amplitude.push_back(power.amplitude);
    }
    spectra.push_back(std::move(spectrum));
  }
  return spectra;
}

// The scatter of a peak's power: the unexplained share, divided by the number of rows.
double scatter_of(const JointSeries& series, double power) {
  return (1.0 - power) / static_cast<double>(series.angle.size());
}

// The roundest number of cycles per turn, or wavelength of a sliding joint, whose power is within
// the scatter of the best one's.
double with_round_number(const JointSeries& series, double cycles, bool slides) {
  const double best = power_at(series, cycles).share;
  const double within = scatter_of(series, best);
  const double exact = slides ? 1.0 / cycles : cycles;
  for (double units = slides ? 1e3 : 1.0; units < 1e7; units *= 10.0) {
    for (const double steps : {units, 2.0 * units}) {
      const double round = std::max(1.0, std::round(exact * steps)) / steps;
      const double rounded = slides ? 1.0 / round : round;
      if (best - power_at(series, rounded).share <= within) return rounded;
    }
  }
  return cycles;
}

}  // namespace

double JointSpectrum::alias_period() const {
  return grid == 0.0 ? 0.0 : (slides ? 1.0 : 2.0 * std::numbers::pi) / grid;
}

double JointSpectrum::folded(double line) const {
  const double period = alias_period();
  return period == 0.0 ? line : std::abs(line - std::round(line / period) * period);
}

std::vector<double> JointSpectrum::aliases(double line) const {
  constexpr std::size_t kNamed = 2;
  constexpr double kSame = 1e-6, kFewest = 0.5;
  const double period = alias_period(), most = slides ? 1.0 / kShortestWave : kWideCycles;
  std::vector<double> result;
  if (period == 0.0) return result;
  const double lowest = folded(line);
  const auto offer = [&](double other) {
    if (other >= kFewest && other <= most && std::abs(other - line) > kSame * line)
      result.push_back(other);
  };
  offer(lowest);
  for (double centre = period; result.size() < kNamed && centre - lowest <= most;
       centre += period) {
    offer(centre - lowest);
    if (result.size() < kNamed) offer(centre + lowest);
  }
  return result;
}

std::vector<JointSpectrum> joint_spectra(const Linearization& linearization, const State& state) {
  return spectra_up_to(linearization, state, cycles_by_ratio);
}

std::vector<JointSpectrum> wide_joint_spectra(const Linearization& linearization,
                                              const State& state) {
  return spectra_up_to(linearization, state, [](const Joint&, double) { return kWideCycles; });
}

std::vector<SpectralPeak> highest_peaks(const JointSpectrum& spectrum,
                                        const Linearization& linearization, const State& state,
                                        std::size_t count) {
  std::vector<std::size_t> tops;
  for (std::size_t i = 1; i + 1 < spectrum.power.size(); ++i) {
    if (spectrum.power[i] >= spectrum.power[i - 1] && spectrum.power[i] > spectrum.power[i + 1])
      tops.push_back(i);
  }
  std::sort(tops.begin(), tops.end(),
            [&](std::size_t a, std::size_t b) { return spectrum.power[a] > spectrum.power[b]; });
  if (tops.size() > count) tops.resize(count);
  const JointSeries series = joint_series(linearization, state, spectrum.joint);
  std::vector<SpectralPeak> peaks;
  for (const std::size_t top : tops) {
    double low = spectrum.cycles[top - 1], high = spectrum.cycles[top + 1];
    // Golden-section search: the peak is smooth within one resolution cell.
    const double golden = (std::sqrt(5.0) - 1.0) / 2.0;
    for (int pass = 0; pass < 24; ++pass) {
      const double a = high - golden * (high - low), b = low + golden * (high - low);
      (power_at(series, a).share > power_at(series, b).share ? high : low) =
          power_at(series, a).share > power_at(series, b).share ? b : a;
    }
    const double finest = (low + high) / 2.0;
    const double cycles = with_round_number(series, finest, spectrum.slides);
    const Power power = power_at(series, cycles);
    peaks.push_back(
        {spectrum.joint, cycles, power.share, power.amplitude, scatter_of(series, power.share)});
  }
  return peaks;
}

bool is_no_chance(const JointSpectrum& spectrum, double power, std::size_t rows) {
  // In white noise, a line explains more than `power` of the squares with probability
  // (1 − power)^((rows − 3)/2) (Scargle 1982, ApJ 263, 835, for residuals of unknown variance).
  const double lines = static_cast<double>(spectrum.power.size());
  return 0.5 * (static_cast<double>(rows) - 3.0) * std::log1p(-std::min(power, 1.0 - 1e-12)) <
         std::log(kChanceOfLine / lines);
}

bool is_told_from(const SpectralPeak& peak, double cycles, const Linearization& linearization,
                  const State& state) {
  const JointSeries series = joint_series(linearization, state, peak.joint);
  return peak.power - power_at(series, cycles).share > peak.within;
}

}  // namespace armtrue
