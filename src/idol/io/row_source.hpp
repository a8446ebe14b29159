// What a file format has to offer: the rows of one stream as the file holds them, and where each stands.
#pragma once

#include <cstddef>
#include <span>
#include <string>

#include "idol/base/input_check.hpp"
#include "idol/base/types.hpp"

namespace idol {

/// Where a stream comes from, for messages.
class StreamPlace {
 public:
  virtual ~StreamPlace() = default;
  /// The stream as its user knows it: the file, with the topic or data set where there are several.
  [[nodiscard]] virtual const std::string& name() const = 0;
  /// Where row `i` of the last piece is: "file:line", or the name and a place in it.
  [[nodiscard]] virtual std::string where(std::size_t i) const = 0;
  /// Share of the stream consumed so far, in [0, 1].
  [[nodiscard]] virtual double progress() const = 0;
};

/// The rows of one stream in the order of the file, in pieces, in bounded memory. Units are those of Event
/// and ImuSample already; order and plausibility are judged by RowStream, for all formats alike.
template <class Row>
class RowSource : public StreamPlace {
 public:
  /// The next rows, valid until the next call. Nothing: the stream is over or, if odd() says so, a row that
  /// cannot be used stands here and others may follow. Throws DataError on damage, after every row before it
  /// was given out; it is not called again then.
  virtual std::span<const Row> read() = 0;
  /// The row that stands where read() came back with nothing; kGood: there is none, the stream is over.
  [[nodiscard]] virtual const RowResult& odd() const {
    static const RowResult kNone;
    return kNone;
  }
};

}  // namespace idol
