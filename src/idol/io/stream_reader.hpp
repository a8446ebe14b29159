// The streams of a recording side by side: spans, packets, and whether they overlap in time.
#pragma once

#include <cstdint>
#include <exception>
#include <memory>
#include <optional>
#include <string>
#include <type_traits>
#include <vector>

#include "idol/io/imu_stream.hpp"
#include "idol/io/reader.hpp"
#include "idol/io/row_stream.hpp"

namespace idol {

class StreamReader : public Reader {
 public:
  /// Throws DataError, and UsageError for an empty span.
  StreamReader(std::unique_ptr<Recording> recording, const ReaderOptions& options);

  std::optional<Packet> next() override;
  [[nodiscard]] bool imu_over() const override { return !imu_ || !imu_->head; }
  [[nodiscard]] Time first_stamp() const override { return first_stamp_; }
  [[nodiscard]] double progress() const override;
  [[nodiscard]] const Diagnostics& diagnostics() const override { return diagnostics_; }

 private:
  /// A stream with its next row in view.
  template <class Row>
  struct Cursor {
    std::conditional_t<std::is_same_v<Row, ImuSample>, ImuStream, RowStream<Row>> stream;
    std::optional<Row> head;  ///< nothing: the stream is over, by its end or by damage
    std::exception_ptr damage;

    void advance();
    [[nodiscard]] const std::string& name() const { return stream.place().name(); }
  };
  template <class Row>
  std::unique_ptr<Cursor<Row>> open(std::unique_ptr<RowSource<Row>> source, InputCheck<Row> check);
  template <class Row>
  std::unique_ptr<RowSource<Row>> source(Diagnostics& diagnostics);
  template <class Row>
  std::size_t find_rows_before_clock(const InputCheck<Row>& check, Diagnostics& diagnostics);
  void open_streams();

  void fill_events();
  bool fill_imu(std::vector<ImuSample>& imu, Time until);
  void check_resolution();
  [[nodiscard]] Time imu_begin() const;
  [[nodiscard]] Time imu_end() const;
  void check_overlap() const;
  std::optional<Packet> end() const;
  [[nodiscard]] std::string span_of_events() const;

  ReaderOptions options_;
  Diagnostics diagnostics_;
  std::unique_ptr<Recording> recording_;
  std::unique_ptr<Cursor<Event>> events_;   // none: the IMU alone
  std::unique_ptr<Cursor<ImuSample>> imu_;  // none: events alone
  Time imu_offset_ = 0;
  Time first_stamp_ = 0;
  Time begin_ = 0;  // span [begin, end)
  Time end_ = 0;
  std::vector<Event> waiting_;  // events of the next packet, until their IMU samples are there too
  bool events_over_ = false;
  std::optional<Time> first_event_, first_imu_;  // of the span; the IMU's on the clock of the camera
  Time last_event_ = 0, last_imu_ = 0;
};

}  // namespace idol
