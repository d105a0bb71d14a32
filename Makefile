# AxisTwin. `make help` lists the verbs; each sets up what it needs (Debian packages, .venv) first.

BUILD   := build
VENV    := .venv
PYTHON  ?= python3
GCC     ?= gcc
CLANG   ?= clang
PREFIX  ?= /usr/local
DESTDIR ?=
VERSION  = $(shell sed -n 's/^version = "\(.*\)"/\1/p' host/pyproject.toml)

# Measured records of real axes; tests that need them say so when they are not there.
export AXISTWIN_DATA ?= $(abspath ../shared/data)

ifndef V # make V=1 shows the commands
.SILENT:
endif
.DELETE_ON_ERROR:
.SECONDARY:
.PHONY: help demo test check size install clean

## help      this list
help:
	sed -n 's/^## //p' Makefile

# ---- Set-up: once, and again when what it depends on changes ------------------------------------

PACKAGES_build := gcc libc6-dev python3-venv python3-dev iproute2 libmodbus-dev
PACKAGES_check := clang clang-format clang-tidy cppcheck shellcheck pkg-config picolibc-arm-none-eabi
PACKAGES_hil   := iproute2 can-utils
PACKAGES_host  := mbpoll
PACKAGES_size  := gcc-arm-none-eabi gcc-riscv64-unknown-elf
PACKAGES_firmware := gcc-arm-none-eabi picolibc-arm-none-eabi qemu-system-arm

$(BUILD)/packages-%: Makefile tests/tools/debian-packages
	mkdir -p $(@D)
	tests/tools/debian-packages install $(PACKAGES_$*)
	touch $@

PIP          := PYTHON=$(PYTHON) tests/tools/python-packages
CORE_SOURCES := $(wildcard lib/*.[ch])
HOST_SOURCES := $(shell find host -type f \( -name '*.py*' -o -name '*.[ch]' -o -name '*.toml' \) \
                        -not -path 'host/build/*' -not -path '*/__pycache__/*')

$(VENV)/.build-tools: tests/tools/constraints.txt tests/tools/python-packages | $(BUILD)/packages-build
	$(PIP) setuptools cffi cantools
	touch $@

# The package is compiled from lib/ and carries the wire contract. setuptools would take up again what
# an earlier build left.
define install-host
	rm -rf host/build
	$(PIP) --no-build-isolation $1
	rm -rf host/build
	touch $@
endef

$(VENV)/.host: $(HOST_SOURCES) $(CORE_SOURCES) $(wildcard drivers/contract/*.dbc drivers/contract/*.csv) \
		$(VENV)/.build-tools
	$(call install-host,./host)

$(VENV)/.host-test: host/pyproject.toml tests/tools/constraints.txt | $(VENV)/.host
	$(call install-host,'./host[test]')

# ---- C: the same sources as several variants, each in a folder of its own -----------------------

WARNINGS     := -Wall -Wextra -Wpedantic -Wconversion -Wdouble-promotion -Wshadow -Werror
CFLAGS       ?= -O2 -g
C_FLAGS      := -std=c11 -ffp-contract=off $(CFLAGS) -MMD -MP
CORE_FLAGS   := $(C_FLAGS) $(WARNINGS) -ffreestanding -Ilib
CONTRACT     := $(BUILD)/contract
DRIVER_FLAGS := $(C_FLAGS) $(WARNINGS) -Ilib -Idrivers/can -Idrivers/node -Idrivers/modbus \
                -Idrivers/firmware -I$(CONTRACT)

CORE     := $(basename $(wildcard lib/*.c))
SERVERS  := $(addprefix drivers/modbus/axt_,modbus_server modbus_tcp modbus_serial register_exchange)
PORTABLE := $(basename $(wildcard drivers/node/*.c) \
                       $(filter-out $(SERVERS:%=%.c),$(wildcard drivers/modbus/*.c))) \
            $(addprefix drivers/firmware/axt_,uart slcan_uart settings record)
LINUX    := $(basename $(wildcard drivers/can/*.c drivers/emulator/*.c)) $(SERVERS)
MAIN     := drivers/emulator/main
LIBRARIES := -lmodbus -lm
UNITS    := $(basename $(notdir $(wildcard tests/unit/test_*.c)))

$(CONTRACT)/axt_contract.c $(CONTRACT)/axt_contract.h &: drivers/contract/axistwin.dbc \
		drivers/contract/generate.py | $(VENV)/.build-tools
	$(VENV)/bin/python drivers/contract/generate.py --code $(CONTRACT)

$(CONTRACT)/axt_register_table.c $(CONTRACT)/axt_register_table.h &: \
		drivers/contract/registers.csv drivers/contract/generate_registers.py \
		drivers/contract/generate.py | $(VENV)/.build-tools
	$(VENV)/bin/python drivers/contract/generate_registers.py --code $(CONTRACT)

CONTRACTS        := axt_contract axt_register_table
CONTRACT_HEADERS := $(CONTRACTS:%=$(CONTRACT)/%.h)

run-programs = status=$(if $^,0,1); for program in $^; do $$program || status=1; done; exit $$status

# $(call variant,NAME,COMPILER,PACKAGES,FLAGS)
define variant
$(BUILD)/$1/lib/%.o: lib/%.c Makefile | $(BUILD)/packages-$3
	mkdir -p $$(@D)
	$2 $$(CORE_FLAGS) $4 -c $$< -o $$@

$(PORTABLE:%=$(BUILD)/$1/%.o): $(BUILD)/$1/%.o: %.c Makefile | $(BUILD)/packages-$3 \
		$(CONTRACT_HEADERS)
	mkdir -p $$(@D)
	$2 $$(DRIVER_FLAGS) -ffreestanding $4 -c $$< -o $$@

$(BUILD)/$1/drivers/%.o: drivers/%.c Makefile | $(BUILD)/packages-$3 $(CONTRACT_HEADERS)
	mkdir -p $$(@D)
	$2 $$(DRIVER_FLAGS) -D_GNU_SOURCE $4 -c $$< -o $$@

$(BUILD)/$1/contract/%.o: $(CONTRACT)/%.c Makefile | $(BUILD)/packages-$3
	mkdir -p $$(@D)
	$2 $$(C_FLAGS) $4 -c $$< -o $$@

$(BUILD)/$1/libaxistwin.a: $(CORE:%=$(BUILD)/$1/%.o)
$(BUILD)/$1/libdrivers.a: $(patsubst %,$(BUILD)/$1/%.o,$(filter-out $(MAIN),$(PORTABLE) $(LINUX)) \
	$(CONTRACTS:%=contract/%))

$(BUILD)/$1/axistwin-emulator: $(BUILD)/$1/$(MAIN).o $(BUILD)/$1/libdrivers.a $(BUILD)/$1/libaxistwin.a
	$2 $4 $$^ $(LIBRARIES) -o $$@

$(BUILD)/$1/unit/%: tests/unit/%.c $(BUILD)/$1/libdrivers.a $(BUILD)/$1/libaxistwin.a
	mkdir -p $$(@D)
	$2 $$(DRIVER_FLAGS) -Itests/unit -D_GNU_SOURCE $4 $$(filter-out %.h,$$^) $(LIBRARIES) -o $$@

unit-$1: $(UNITS:%=$(BUILD)/$1/unit/%)
	$$(run-programs)

-include $(wildcard $(BUILD)/$1/*/*.d $(BUILD)/$1/*/*/*.d)
endef

SANITIZE := -fsanitize=address,undefined -fno-sanitize-recover=all -fno-omit-frame-pointer
REALS    := float double
VARIANTS := $(foreach tool,gcc clang sanitized,$(REALS:%=$(tool)-%))

$(foreach real,$(REALS),\
    $(eval $(call variant,gcc-$(real),$(GCC),build,-DAXT_REAL=$(real)))\
    $(eval $(call variant,clang-$(real),$(CLANG),check,-DAXT_REAL=$(real)))\
    $(eval $(call variant,sanitized-$(real),$(GCC),build,-DAXT_REAL=$(real) $(SANITIZE))))

# Multiplies and adds as a Cortex-M4F does, in one rounding.
$(eval $(call variant,fused,$(GCC),build,-DAXT_REAL=float -DAXT_FUSED=1))

# The node hands over between two threads without a lock: a data race is a failure.
$(eval $(call variant,racing,$(GCC),build,-fsanitize=thread))

races: $(patsubst %,$(BUILD)/racing/unit/%,$(filter %_threads,$(UNITS)))
	$(run-programs)

%.a:
	rm -f $@
	ar rcs $@ $^

# Installed, not copied: one that runs goes on with the old file.
EMULATORS := $(BUILD)/axistwin-emulator $(BUILD)/sanitized/axistwin-emulator

$(BUILD)/axistwin-emulator: $(BUILD)/gcc-float/axistwin-emulator
	install $< $@

$(BUILD)/sanitized/axistwin-emulator: $(BUILD)/sanitized-float/axistwin-emulator
	mkdir -p $(@D)
	install $< $@

# What runs on the board that the tests talk to (tests/board.py).
BOARD_IMAGE := $(BUILD)/firmware/cortex-m4f.elf

# A microcontroller's Modbus server on a serial port, for the tests to talk to.
RTU_NODE := $(BUILD)/modbus-rtu-node

$(RTU_NODE): tests/host/modbus_rtu_node.c $(BUILD)/sanitized-float/libdrivers.a \
		$(BUILD)/sanitized-float/libaxistwin.a
	$(GCC) $(DRIVER_FLAGS) -Itests/unit -D_GNU_SOURCE $(SANITIZE) $^ $(LIBRARIES) -o $@

# ---- Firmware: one source, an image for each board (QEMU has them all) -------------------------------

FIRMWARE        := $(BUILD)/firmware
PROCESSOR_FILES := $(addprefix drivers/firmware/,main.c cortex_m.c cmsdk.c memory.c \
                     axt_emulated_hardware.c) $(wildcard drivers/firmware/mps2*.c)
IMAGE_PARTS     := $(CORE) $(PORTABLE) $(addprefix drivers/can/axt_,can slcan slcan_link) \
                   $(filter-out drivers/firmware/mps2_%,$(PROCESSOR_FILES:%.c=%)) \
                   $(CONTRACTS:%=contract/%)

# What no option of -O2 does: drop what is not called, and note the stack that functions take.
IMAGE_FLAGS := -ffreestanding -ffunction-sections -fdata-sections -fstack-usage \
               --specs=picolibc.specs
LINK_FLAGS   = --specs=picolibc.specs -nostartfiles -Wl,--gc-sections -Wl,-Map=$(@:.elf=.map) \
               -Ldrivers/firmware

# $(call image,NAME,BOARD,PROCESSOR)
define image
$(FIRMWARE)/$1/%.o: %.c Makefile | $(BUILD)/packages-firmware $(CONTRACT_HEADERS)
	mkdir -p $$(@D)
	arm-none-eabi-gcc $$(DRIVER_FLAGS) $(IMAGE_FLAGS) $3 -c $$< -o $$@

$(FIRMWARE)/$1/contract/%.o: $(CONTRACT)/%.c Makefile | $(BUILD)/packages-firmware
	mkdir -p $$(@D)
	arm-none-eabi-gcc $$(C_FLAGS) $(IMAGE_FLAGS) $3 -c $$< -o $$@

$(FIRMWARE)/$1.elf: $(IMAGE_PARTS:%=$(FIRMWARE)/$1/%.o) $(FIRMWARE)/$1/drivers/firmware/$2.o \
		drivers/firmware/sections.ld drivers/firmware/$2.ld
	arm-none-eabi-gcc $3 $$(LINK_FLAGS) -T $2.ld $$(filter %.o,$$^) -lm -o $$@

-include $(wildcard $(FIRMWARE)/$1/*/*.d $(FIRMWARE)/$1/*/*/*.d)
endef

# As the targets of tests/tools/size.py.
IN_ORDER := -fno-schedule-insns
$(eval $(call image,cortex-m3,mps2_an386,-mcpu=cortex-m3 -mthumb $(IN_ORDER)))
$(eval $(call image,cortex-m4f,mps2_an386,-mcpu=cortex-m4 -mthumb -mfpu=fpv4-sp-d16 \
    -mfloat-abi=hard $(IN_ORDER)))
$(eval $(call image,cortex-m7,mps2_an386,-mcpu=cortex-m7 -mthumb -mfpu=fpv5-sp-d16 \
    -mfloat-abi=hard))
$(eval $(call image,cortex-m33,mps2_an505,-mcpu=cortex-m33 -mthumb -mfpu=fpv5-sp-d16 \
    -mfloat-abi=hard $(IN_ORDER)))
IMAGES := $(patsubst %,$(FIRMWARE)/%.elf,cortex-m3 cortex-m4f cortex-m7 cortex-m33)

measure-firmware = PYTHONPATH=tests $(VENV)/bin/python tests/firmware/measure.py $(BUILD)/firmware.json

.PHONY: firmware README.md
## firmware  images for Cortex-M3, M4F, M7 and M33 (build/firmware), their size and speed (build/firmware.json)
firmware: $(IMAGES) $(VENV)/.host
	$(measure-firmware)

README.md: $(IMAGES) $(VENV)/.host
	$(measure-firmware) --page $@

# ---- Suites: each a target of its own; tests/tools/suites.py runs them and counts ----------------

RESULTS := $(BUILD)/results
PYTEST  := $(VENV)/bin/python -m pytest -c host/pyproject.toml --rootdir=. -o cache_dir=$(BUILD)/pytest
C_FILES := $(wildcard lib/*.[ch] host/native/*.[ch] drivers/*/*.[ch] tests/unit/*.[ch] tests/host/*.c tests/readme/*.c)
PY_CODE := host drivers tests
SCRIPTS := $(filter-out %.py %.txt,$(wildcard tests/tools/*)) .ci/run
QUICK   := $(addprefix unit-,gcc-float gcc-double) host-tests \
           $(addprefix lint-,ruff ruff-format mypy clang-format clang-tidy cppcheck shellcheck) \
           wire-page registers-page
ALL     := $(QUICK) $(filter-out $(QUICK),$(VARIANTS:%=unit-%)) races size installed \
           firmware-tests firmware-page hidden-tests hil-serial hil

.PHONY: $(ALL)

host-tests: $(VENV)/.host-test $(EMULATORS) $(RTU_NODE) $(BOARD_IMAGE) | $(BUILD)/packages-host
	$(PYTEST) -qq --junitxml=$(RESULTS)/$@.xml tests/host

# What needs no CAN of the kernel's takes a tenth of the time outside of a guest.
hil-serial: $(VENV)/.host-test $(EMULATORS) $(BOARD_IMAGE)
	$(PYTEST) -qq --junitxml=$(RESULTS)/$@.xml --carriers=pty,tcp,firmware tests/hil

hil: $(VENV)/.host-test $(EMULATORS) $(BOARD_IMAGE) | $(BUILD)/packages-hil
	AXISTWIN_VCAN_BOARD=1 tests/tools/with-vcan \
	    $(PYTEST) -qq --junitxml=$(RESULTS)/$@.xml --carriers=vcan,interface tests/hil

firmware-tests: $(VENV)/.host-test $(IMAGES) $(BUILD)/fused/axistwin-emulator
	$(PYTEST) -qq --junitxml=$(RESULTS)/$@.xml tests/firmware

lint-ruff: $(VENV)/.host-test
	$(VENV)/bin/ruff check --quiet $(PY_CODE)

lint-ruff-format: $(VENV)/.host-test
	$(VENV)/bin/ruff format --check --quiet $(PY_CODE)

lint-mypy: $(VENV)/.host-test
	$(VENV)/bin/mypy --config-file host/pyproject.toml --cache-dir $(BUILD)/mypy $(PY_CODE)

lint-clang-format: $(BUILD)/packages-check
	clang-format --dry-run -Werror $(C_FILES) $(wildcard tests/proof/*.[ch] tests/fuzz/*.[ch])

# What is for a microcontroller alone is looked at as for one.
lint-clang-tidy: $(BUILD)/packages-check $(CONTRACT_HEADERS)
	printf '%s\n' $(filter-out $(PROCESSOR_FILES),$(filter %.c,$(C_FILES))) | \
	    xargs --max-args=4 --max-procs=$$(nproc) sh -c \
	    'clang-tidy --quiet "$$@" -- $(DRIVER_FLAGS) -Itests/unit -D_GNU_SOURCE' sh
	clang-tidy --quiet $(PROCESSOR_FILES) -- $(DRIVER_FLAGS) -ffreestanding \
	    --target=thumbv7em-none-eabihf -isystem /usr/lib/picolibc/arm-none-eabi/include

lint-cppcheck: $(BUILD)/packages-check
	cppcheck --quiet --std=c11 --error-exitcode=1 --inline-suppr --suppress=missingIncludeSystem \
	    --suppress='unusedStructMember:drivers/firmware/*' \
	    --enable=warning,style,performance,portability -Ilib -Idrivers/can -Idrivers/node \
	    -Idrivers/modbus -I$(CONTRACT) lib drivers

lint-shellcheck: $(BUILD)/packages-check
	shellcheck $(SCRIPTS)

wire-page: $(VENV)/.build-tools
	$(VENV)/bin/python drivers/contract/generate.py --check docs/wire.md

registers-page: $(VENV)/.build-tools
	$(VENV)/bin/python drivers/contract/generate_registers.py --check docs/registers.md

firmware-page: $(IMAGES) $(VENV)/.host
	$(measure-firmware) --check README.md

installed: $(BUILD)/packages-check
	$(MAKE) install DESTDIR= PREFIX=$(abspath $(BUILD)/installed)
	tests/tools/check-installed $(abspath $(BUILD)/installed)

# ---- Verbs ---------------------------------------------------------------------------------------

## demo      identify an emulated axis over CAN, from nothing to a table and plots
demo: $(VENV)/.host $(BUILD)/axistwin-emulator
	$(VENV)/bin/axistwin demo --output $(BUILD)/demo

## check     the quick part of the tests: unit and host tests, linters
check: $(VENV)/.host-test
	$(VENV)/bin/python tests/tools/suites.py $(QUICK)

## test      everything: all variants, cross compilation, hardware in the loop on a real vcan
test: $(VENV)/.host-test
	$(VENV)/bin/python tests/tools/suites.py --show hil $(ALL)

## size      text, data, stack and state by target (build/size.json)
size: $(BUILD)/packages-size $(BUILD)/packages-build
	CORE_FLAGS="$(CORE_FLAGS)" $(PYTHON) tests/tools/size.py $(BUILD)/size.json

docs/wire.md: drivers/contract/axistwin.dbc drivers/contract/generate.py | $(VENV)/.build-tools
	$(VENV)/bin/python drivers/contract/generate.py --page $@

docs/registers.md: drivers/contract/registers.csv drivers/contract/axistwin.dbc \
		drivers/contract/generate_registers.py drivers/contract/generate.py | $(VENV)/.build-tools
	$(VENV)/bin/python drivers/contract/generate_registers.py --page $@

INSTALLED      := $(DESTDIR)$(PREFIX)
PUBLIC_HEADERS := $(shell grep --files-without-match 'Private to lib/' lib/*.h)

# $(call install-library,NAME,REAL)
define install-library
	install -m 644 $(BUILD)/gcc-$2/libaxistwin.a $(INSTALLED)/lib/lib$1.a
	sed 's|@PREFIX@|$(PREFIX)|; s|@NAME@|$1|; s|@REAL@|$2|; s|@VERSION@|$(VERSION)|' \
	    lib/axistwin.pc.in >$(INSTALLED)/lib/pkgconfig/$1.pc
endef

## install   library, headers, pkg-config files, emulator; PREFIX= DESTDIR=
install: $(REALS:%=$(BUILD)/gcc-%/libaxistwin.a) $(BUILD)/axistwin-emulator
	install -d $(INSTALLED)/bin $(INSTALLED)/include/axistwin $(INSTALLED)/lib/pkgconfig
	install -m 755 $(BUILD)/axistwin-emulator $(INSTALLED)/bin
	install -m 644 $(PUBLIC_HEADERS) $(INSTALLED)/include/axistwin
	$(call install-library,axistwin,float)
	$(call install-library,axistwin-double,double)

## clean     remove what was built (not .venv)
clean:
	rm -rf $(BUILD)

# ---- Bench: what the core costs and survives, what the bus carries ---------------------------------

PACKAGES_bench := gcc gcc-arm-none-eabi picolibc-arm-none-eabi qemu-system-arm valgrind

$(VENV)/.bench: tests/tools/constraints.txt | $(VENV)/.build-tools
	$(PIP) numpy scipy padasip filterpy
	touch $@

BENCH_PEERS := $(BUILD)/bench/modbus_load $(BUILD)/bench/modbus_plain

$(BENCH_PEERS): $(BUILD)/bench/%: tests/bench/%.c Makefile | $(BUILD)/packages-build $(CONTRACT_HEADERS)
	mkdir -p $(@D)
	$(GCC) $(DRIVER_FLAGS) -D_GNU_SOURCE $< $(LIBRARIES) -o $@

.PHONY: bench
## bench     cost and survival beside their targets (build/bench.json); PART=instructions.cortex-m4f: only that
bench: $(BUILD)/packages-build $(BUILD)/packages-bench $(BUILD)/packages-hil $(VENV)/.bench \
		$(VENV)/.hidden $(VENV)/.host $(BENCH_PEERS) $(BUILD)/axistwin-emulator
	CORE_FLAGS="$(CORE_FLAGS)" NUMBA_CACHE_DIR=$(BUILD)/numba PYTHONPATH=tests/tools:tests/hidden:tests/host \
	    $(VENV)/bin/python tests/bench/bench.py $(PART)

# ---- Proof: for all values, not for those that a test tries ------------------------------------------

PACKAGES_proof := frama-c-base gappa

.PHONY: proof
## proof     no undefined behaviour, and bounds that last: plant, RLS, codecs, by Frama-C (build/proof.json)
proof: $(BUILD)/packages-build $(BUILD)/packages-proof $(CONTRACT)/axt_contract.h
	$(PYTHON) tests/proof/proof.py $(BUILD)/proof.json

# ---- Hidden: effects in records of an independent simulator, to be found ------------------------------

# The simulator is Python that numba compiles; what it compiled is kept. Two processes share the
# cores: more threads in each would wait for one another.
HIDDEN := OMP_NUM_THREADS=1 NUMBA_CACHE_DIR=$(BUILD)/numba PYTHONPATH=tests/hidden

$(VENV)/.hidden: tests/tools/constraints.txt | $(VENV)/.host-test
	$(PIP) numba
	touch $@

# Not in the way of pytest's default, which lets tests/coverage pass for the package of that name.
hidden-tests: $(VENV)/.hidden
	$(HIDDEN) $(PYTEST) --import-mode=importlib -qq --junitxml=$(RESULTS)/$@.xml tests/hidden

N ?= 500

.PHONY: hidden
## hidden    N= records with effects that have to be found, new ones unless SEED= (build/hidden.json)
hidden: $(VENV)/.hidden
	$(HIDDEN) $(VENV)/bin/python tests/hidden/hidden.py run --count $(N) \
	    $(if $(filter-out file,$(origin SEED)),--seed $(SEED)) --output $(BUILD)/hidden.json \
	    --figure $(BUILD)/hidden-confusion.png

# ---- Coverage and mutation: what the unit tests of lib/ see -----------------------------------------

PACKAGES_coverage := clang-19 llvm-19 libclang-rt-19-dev libmodbus-dev

# Instrumented code is slow without -O1; what a newer compiler warns of is not asked here.
$(eval $(call variant,covered,clang-19,coverage,-DAXT_REAL=float -O1 -w -fprofile-instr-generate \
    -fcoverage-mapping -fcoverage-mcdc))

# A unit test of lib/ is named after the file that it tests.
CORE_UNITS := $(filter $(CORE:lib/axt_%=test_%),$(UNITS))

.PHONY: coverage
## coverage  lines, branches and MC/DC of lib/ by its unit tests (build/coverage.json)
coverage: $(CORE_UNITS:%=$(BUILD)/covered/unit/%)
	$(PYTHON) tests/coverage/coverage.py $(BUILD)/coverage.json $^

MUTANTS ?= 200
SEED    ?= 1

.PHONY: mutation
## mutation  MUTANTS= wrong operators in lib/, and which the unit tests miss; SEED= (build/mutation.json)
mutation: $(BUILD)/gcc-float/libdrivers.a
	CORE_FLAGS="$(CORE_FLAGS)" TEST_FLAGS="$(DRIVER_FLAGS) -Itests/unit -D_GNU_SOURCE" \
	    DRIVERS="$<" $(PYTHON) tests/mutation/mutation.py $(BUILD)/mutation.json \
	    $(MUTANTS) $(SEED) $(CORE_UNITS:%=tests/unit/%.c)

# ---- Fuzz: what no test thought of -------------------------------------------------------------------

PACKAGES_fuzz := clang libmodbus-dev
FUZZERS       := $(patsubst tests/fuzz/fuzz_%.c,$(BUILD)/fuzz/%,$(wildcard tests/fuzz/fuzz_*.c))
FUZZ_SECONDS  ?= 20

$(eval $(call variant,fuzzed,$(CLANG),fuzz,-DAXT_REAL=float $(SANITIZE) -fsanitize=fuzzer-no-link))

# The messages of the generated codec as a macro, so that none is left out.
$(BUILD)/fuzz/messages.h: $(CONTRACT)/axt_contract.h
	mkdir -p $(@D)
	printf '#define CONTRACT_MESSAGES(X) %s\n' \
	    "$$(sed -n 's/^int axt_contract_\(.*\)_unpack($$/X(\1, \U\1)/p' $< | tr '\n' ' ')" >$@

$(BUILD)/fuzz/%: tests/fuzz/fuzz_%.c $(BUILD)/fuzz/messages.h $(BUILD)/fuzzed/libdrivers.a \
		$(BUILD)/fuzzed/libaxistwin.a
	$(CLANG) $(DRIVER_FLAGS) -Itests/unit -I$(BUILD)/fuzz -D_GNU_SOURCE $(SANITIZE) \
	    -fsanitize=fuzzer $(filter-out %.h,$^) $(LIBRARIES) -pthread -o $@

-include $(wildcard $(BUILD)/fuzz/*.d)

.PHONY: fuzz
## fuzz      any bits into the core, the codecs and the protocols, FUZZ_SECONDS= each (build/fuzz.json)
fuzz: $(FUZZERS)
	$(PYTHON) tests/fuzz/fuzz.py $(BUILD)/fuzz.json $(FUZZ_SECONDS) $^

# ---- Paper: the source paper reproduced, corrected and carried on ---------------------------------

.PHONY: paper
## paper     every table and figure of the source paper beside ours (build/paper), the example of a
##           diagnosis (build/diagnosis), and docs/*.md that quote them
paper: $(VENV)/.host
	$(VENV)/bin/python -m axistwin.paper --output $(BUILD)/paper --docs docs
	$(VENV)/bin/python -m axistwin.diagnose.example --build $(BUILD)
