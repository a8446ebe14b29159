#include "idol/io/imu_stream.hpp"

#include <fmt/format.h>

namespace idol {

bool ImuStream::next(ImuSample& out) {
  while (next_ == ready_.samples.size()) {
    if (damage_) std::rethrow_exception(damage_);
    if (over_) return false;
    ready_.samples.clear();
    next_ = 0;
    read();
  }
  out = ready_.samples[next_++];
  return true;
}

void ImuStream::read() {
  ImuSample sample;
  try {
    over_ = !rows_.next(sample);
  } catch (const DataError&) {
    damage_ = std::current_exception();
  }
  const std::int64_t spread = bursts_.spread();
  if (over_ || damage_) {
    bursts_.flush(ready_);
  } else {
    if (first_doubtful_.empty()) first_doubtful_ = rows_.repeated_at();
    bursts_.push(sample, ready_);
  }
  count_repeats(sample);
  if (bursts_.spread() > spread) bursts_.report(rows_.place().name() + ": ", diagnostics_);
}

void ImuStream::count_repeats(const ImuSample& newest) {
  for (const ImuSample& repeat : ready_.repeats) {
    const std::string& place = repeat.t == newest.t ? rows_.repeated_at() : first_doubtful_;
    diagnostics_.warn("duplicate_imu_stamp",
                      fmt::format("{}: the stamp of the row before; row skipped", place));
  }
  ready_.repeats.clear();
}

}  // namespace idol
