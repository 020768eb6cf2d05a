# Made by `make surface`; labanmesh completion prints it.
_labanmesh() {
    local word=${COMP_WORDS[COMP_CWORD]} first=${COMP_WORDS[1]} second=${COMP_WORDS[2]} words=
    if [ "$COMP_CWORD" -eq 1 ]; then
        words="demo init up teach doctor watch dashboard count history notify hub capture replay camera phone import learn forget score evaluate observe fuse router secure completion new"
    else
        case "$first $second" in
            "demo "*) words="--output --seed --pixels --no-pixels" ;;
            "init "*) words="--source --look --no-look" ;;
            "up "*) words="--for --exit-when-done" ;;
            "teach "*) words="--takes --background-minutes --person --add --reference --seconds --countdown --test --no-test --alarm-minutes --begin --up --rehearse --was --learn --earlier --restore --film --observer" ;;
            "doctor "*) words="--json --for --verbose --cameras --observers --ready --process" ;;
            "watch "*) words="--json --for" ;;
            "dashboard "*) words="--capture --listen --token-file --teach --for" ;;
            "count "*) words="--target --once --json --for" ;;
            "history "*) words="--day --from --to --kind --label --last --csv --json" ;;
            "notify "*) words="--test" ;;
            "hub mqtt") words="--remove" ;;
            "hub events") words="" ;;
            "hub "*) words="mqtt events" ;;
            "capture "*) words="--output -o --for" ;;
            "replay "*) words="--without --rule --quorum --threshold --json --onto --speed --only" ;;
            "camera look") words="--tracker -o --output --frames --pose-model --skin --face --save-skin --view --recording --show" ;;
            "camera calibrate") words="--board --points --read --lens -o --output --origin --lying --apart --up --every" ;;
            "camera place") words="--seconds --observers --gate" ;;
            "camera record") words="-o --output --subject --label --other-motion --trial --seconds --observers --rate --gate --up --front --trim" ;;
            "camera "*) words="look calibrate place record" ;;
            "phone "*) words="--listen --host --certificate --teach --no-teach --list --revoke --fetch --from --for" ;;
            "import "*) words="-o --output --seen-from" ;;
            "learn "*) words="-o --output --view --place --facing --scene --observers --sensor --model --labels --subjects --body-parts --rate --add-to --background --background-labels --name --parameter --effort --known-people --reference --jobs" ;;
            "forget "*) words="--person --label --all --clips --yes --labels -o --output" ;;
            "score "*) words="--references --label --subjects --trials --reference-trials --views --report --json" ;;
            "evaluate "*) words="--views --place --facing --sensor --labels --train-subjects --test-subjects --leave-one-subject-out --model --rule --parameter --turn --fault --uncalibrated --unlearned --background-labels --body-parts --onset --stream --background --background-subjects --other-motion --jobs --seed --report --json --paper --effort" ;;
            "observe "*) words="" ;;
            "fuse "*) words="--id" ;;
            "router "*) words="--scene --config" ;;
            "secure init") words="--to" ;;
            "secure add") words="--observer --fusion --hub --hub-of --router --pictures --teach --history --host --days --to" ;;
            "secure renew") words="--host --days --to" ;;
            "secure revoke") words="--to" ;;
            "secure list") words="--json --to" ;;
            "secure rules") words="--credentials --listen --to" ;;
            "secure "*) words="init add renew revoke list rules" ;;
            "completion "*) words="" ;;
            "new "*) words="-o --output" ;;
        esac
    fi
    # Without a word of ours the shell completes the name of a file.
    case $words in -*) case $word in -*) ;; *) words= ;; esac ;; esac
    COMPREPLY=($(compgen -W "$words" -- "$word"))
}
complete -o default -F _labanmesh labanmesh
