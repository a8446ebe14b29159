#include "idol/io/clock_check.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>

namespace idol {
namespace {

constexpr Time kBin = 10'000'000;  // [ns]
constexpr std::size_t kMostBins = 60'000;
constexpr std::ptrdiff_t kLargestShift = 100;          // bins
constexpr std::ptrdiff_t kOther = 20;                  // bins: an offset that differs by more is another one
constexpr std::size_t kHalfSecond = 50, kLeast = 300;  // bins

/// Less its mean over a second: only changes say something about time.
std::vector<double> changes(const std::vector<double>& x) {
  std::vector<double> sums{0};
  for (const double v : x) sums.push_back(sums.back() + v);
  std::vector<double> out;
  for (std::size_t i = 0; i < x.size(); ++i) {
    const std::size_t from = i < kHalfSecond ? 0 : i - kHalfSecond,
                      to = std::min(x.size(), i + kHalfSecond + 1);
    out.push_back(x[i] - (sums[to] - sums[from]) / static_cast<double>(to - from));
  }
  return out;
}

/// Correlation of a[i] with b[i + shift].
double correlation(const std::vector<double>& a, const std::vector<double>& b, std::ptrdiff_t shift) {
  double ab = 0, aa = 0, bb = 0;
  const auto size = static_cast<std::ptrdiff_t>(a.size());
  for (std::ptrdiff_t i = std::max<std::ptrdiff_t>(0, -shift); i < std::min(size, size - shift); ++i) {
    const double x = a[static_cast<std::size_t>(i)], y = b[static_cast<std::size_t>(i + shift)];
    ab += x * y, aa += x * x, bb += y * y;
  }
  return aa > 0 && bb > 0 ? ab / std::sqrt(aa * bb) : 0;
}

}  // namespace

ClockCheck::Bin* ClockCheck::bin_of(Time t) {
  if (!origin_) origin_ = t - 100 * kBin;  // the other stream may begin a little earlier
  if (t < *origin_ || t - *origin_ >= kBin * static_cast<Time>(kMostBins)) return nullptr;
  const auto i = static_cast<std::size_t>((t - *origin_) / kBin);
  if (i >= bins_.size()) bins_.resize(i + 1);
  return &bins_[i];
}

void ClockCheck::add(const Packet& packet) {
  for (const Event& e : packet.events)
    if (Bin* bin = bin_of(e.t)) ++bin->events;
  for (const ImuSample& s : packet.imu) {
    Bin* bin = bin_of(s.t);
    if (bin == nullptr) continue;
    ++bin->samples;
    bin->rate_sum += s.gyro.norm();
  }
}

std::optional<ClockCheck::Offset> ClockCheck::offset() const {
  const auto both = [](const Bin& bin) { return bin.events > 0 && bin.samples > 0; };
  const auto begin = std::find_if(bins_.begin(), bins_.end(), both);
  const auto end = std::find_if(bins_.rbegin(), bins_.rend(), both).base();
  if (begin >= end || end - begin < static_cast<std::ptrdiff_t>(kLeast)) return std::nullopt;
  // Logarithms: the rate of events depends on the scene too, as a factor.
  std::vector<double> events, rates;
  constexpr double kFloor = 0.05;  // [rad/s], of bias and noise
  for (auto bin = begin; bin != end; ++bin) {
    events.push_back(std::log(static_cast<double>(bin->events + 1)));
    rates.push_back(bin->samples > 0 ? std::log(bin->rate_sum / static_cast<double>(bin->samples) + kFloor)
                                     : (rates.empty() ? std::log(kFloor) : rates.back()));
  }
  const auto a = changes(events), b = changes(rates);
  std::vector<double> match;
  for (std::ptrdiff_t shift = -kLargestShift; shift <= kLargestShift; ++shift)
    match.push_back(correlation(a, b, shift));
  const auto best = std::max_element(match.begin(), match.end());
  Offset offset{
      static_cast<double>(best - match.begin() - kLargestShift) * static_cast<double>(kBin) / kNsPerS, *best,
      -1};
  for (auto m = match.begin(); m != match.end(); ++m)
    if (std::abs(m - best) > kOther) offset.runner_up = std::max(offset.runner_up, *m);
  return offset;
}

}  // namespace idol
